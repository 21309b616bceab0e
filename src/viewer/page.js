// The last part of a page that opens from disk: draws what stands in it, and turns it. Not loaded by the viewer itself.

import { wrapped } from './camera.js';
import { Scene } from './scene.js';

const kinds = { Float32Array, Uint32Array, Int8Array, Uint8Array };
const read = ([kind, text]) => new kinds[kind](Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
const page = JSON.parse(document.getElementById('data').textContent);
const canvas = document.getElementById('canvas');
const scene = new Scene(canvas);
scene.setPoints(read(page.arrays.positions), page.ball, page.radius);
for (const [name, data] of Object.entries(page.arrays)) if (name !== 'positions') scene.set(name, read(data));
Object.assign(scene, { paint: page.paint, background: page.background });
document.title = page.name;
const legend = page.legend ? `${page.legend.title}: ${page.legend.low.toPrecision(3)} to ${page.legend.high.toPrecision(3)} ${page.legend.unit}` : '';
document.getElementById('caption').textContent = [page.name, legend].filter(Boolean).join(' · ');
const seen = page.view;
const draw = () => {
  scene.ratio = window.devicePixelRatio;
  [canvas.width, canvas.height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * scene.ratio)));
  window.chladni = { drawn: scene.draw(seen) };
};
const turned = (right, up) => {
  seen.azimuth = wrapped(seen.azimuth - right);
  seen.elevation = Math.min(90, Math.max(-90, seen.elevation + up));
  draw();
};
canvas.addEventListener('pointermove', (event) => { if (event.buttons) turned(0.4 * event.movementX, 0.4 * event.movementY); });
canvas.addEventListener('wheel', (event) => { seen.zoom *= Math.exp(-event.deltaY / 500); draw(); });
canvas.addEventListener('keydown', (event) => {
  const step = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, -6], ArrowDown: [0, 6] }[event.key];
  if (step) turned(...step);
});
window.addEventListener('resize', draw);
scene.onRestored = draw;
draw();
