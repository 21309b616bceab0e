// When and how finely the scene is drawn: while it moves quickly, at rest with more pixels than the screen has.

import { find } from './dom.js';
import { status, view } from './state.js';

const REST_MILLISECONDS = 180;
// Points that are drawn while the view moves, at most; fewer where that takes too long.
const MOST = 2e6;
const LEAST = 1e5;
const [SLOW, FAST] = [45, 20];
const FINE = 2;

export class Renderer {
  constructor(scene) {
    Object.assign(this, { scene, most: MOST, scheduled: 0, moving: false, last: 0, drawnOnce: [] });
    new ResizeObserver(() => this.redraw()).observe(scene.canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.recolor());
    scene.onRestored = () => this.redraw();
    this.recolor();
  }

  /** The background is that of the page. */
  recolor() {
    const pen = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
    pen.fillStyle = getComputedStyle(find('stage')).backgroundColor;
    pen.fillRect(0, 0, 1, 1);
    this.scene.background = [...pen.getImageData(0, 0, 1, 1).data].slice(0, 3).map((byte) => byte / 255);
    this.redraw();
  }

  /** The view moves: drawn quickly until it has rested. */
  moved() {
    this.moving = true;
    clearTimeout(this.resting);
    this.resting = setTimeout(() => { this.moving = false; this.last = 0; this.redraw(); }, REST_MILLISECONDS);
    this.redraw();
  }

  redraw() { this.scheduled ||= requestAnimationFrame((time) => this.frame(time)); }

  /** Resolves once what is set by now is on the screen. */
  drawn() {
    this.redraw();
    return new Promise((resolve) => { this.drawnOnce.push(resolve); });
  }

  frame(time) {
    this.scheduled = 0;
    if (this.moving && this.last) this.adapt(time - this.last);
    this.last = this.moving ? time : 0;
    this.drawNow(this.moving ? Math.min(devicePixelRatio, FINE) : Math.max(devicePixelRatio, FINE));
    this.drawnOnce.splice(0).forEach((resolve) => resolve());
  }

  adapt(milliseconds) {
    if (milliseconds > 1000) return;
    status.frameMilliseconds = milliseconds;
    if (milliseconds > SLOW) this.most = Math.max(LEAST, Math.min(this.most, status.drawn) * 0.7);
    else if (milliseconds < FAST) this.most = Math.min(MOST, this.most * 1.2);
  }

  drawNow(ratio) {
    const { scene, scene: { canvas } } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * ratio)));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    scene.ratio = ratio;
    status.drawn = scene.draw(view, this.moving ? Math.floor(this.most) : Infinity);
    status.frames += 1;
  }

  /** Milliseconds of a frame as it is drawn while the view moves, the card's work included; of all points or `most`. */
  measure(frames = 10, most = Infinity) {
    const { gl } = this.scene;
    const times = [];
    for (let i = 0; i < frames; i += 1) {
      const began = performance.now();
      view.azimuth += 1;
      this.scene.draw(view, most);
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      times.push(performance.now() - began);
    }
    view.azimuth -= frames;
    this.redraw();
    return times.sort((a, b) => a - b)[frames >> 1];
  }
}
