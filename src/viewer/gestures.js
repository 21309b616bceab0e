// Mouse, touch and keys on the canvas: one finger turns, two move and zoom, a tap picks.

import { wrapped } from './camera.js';
import { change, view } from './state.js';

const DEGREES_PER_PIXEL = 0.4;
const TAP_PIXELS = 5;
const KEY_DEGREES = 6;
const KEY_SHARE = 0.08;
const bounded = (x, low, high) => Math.min(Math.max(x, low), high);

function turn(right, up) {
  change({ azimuth: wrapped(view.azimuth - right), elevation: bounded(view.elevation + up, -90, 90) });
}

function zoom(factor) { change({ zoom: bounded(view.zoom * factor, 0.02, 500) }); }

function pan(right, up) { change({ x: bounded(view.x + right / view.zoom, -10, 10), y: bounded(view.y + up / view.zoom, -10, 10) }); }

export function listen(canvas, { tapped, moved, mode }) {
  const pointers = new Map();
  let [traveled, gap] = [0, 0];
  // Pixels of the ball's radius at zoom 1.
  const scale = () => 0.5 * Math.min(canvas.clientWidth, canvas.clientHeight);
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };

  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (pointers.size === 1) traveled = 0;
    if (pointers.size === 2) { gap = spread(); traveled = Infinity; }
  });
  canvas.addEventListener('pointermove', (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before.x, event.clientY - before.y];
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    traveled += Math.hypot(dx, dy);
    if (traveled < TAP_PIXELS) return;
    moved();
    if (pointers.size > 1) {
      pan(dx / scale() / pointers.size, -dy / scale() / pointers.size);
      const now = spread();
      if (gap > 0 && now > 0) zoom(now / gap);
      gap = now;
    } else if (event.buttons & 6 || event.shiftKey) {
      pan(dx / scale(), -dy / scale());
    } else {
      turn(dx * DEGREES_PER_PIXEL, dy * DEGREES_PER_PIXEL);
    }
  });
  const lifted = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    if (event.type === 'pointerup' && traveled < TAP_PIXELS && event.button === 0) tapped(event.offsetX, event.offsetY);
  };
  canvas.addEventListener('pointerup', lifted);
  canvas.addEventListener('pointercancel', lifted);
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    moved();
    zoom(Math.exp(-bounded(event.deltaY * (event.deltaMode ? 30 : 1), -200, 200) / 500));
  }, { passive: false });
  canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const other = {
      '+': () => zoom(1.15), '=': () => zoom(1.15), '-': () => zoom(1 / 1.15), 0: () => change({ zoom: 1, x: 0, y: 0 }),
      ',': () => mode(-1), '.': () => mode(1), PageDown: () => mode(1), PageUp: () => mode(-1),
      Enter: () => tapped(canvas.clientWidth / 2, canvas.clientHeight / 2),
    }[event.key];
    if (!step && !other) return;
    event.preventDefault();
    moved();
    if (other) other();
    else if (event.shiftKey) pan(KEY_SHARE * step[0], -KEY_SHARE * step[1]);
    else turn(step[0] * KEY_DEGREES, step[1] * KEY_DEGREES);
  });
}
