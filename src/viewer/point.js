// What is known of the picked point: row, coordinates, fields, value, and its heat kernel signature as a curve.

import { find, make, number, svg } from './dom.js';

const [WIDTH, HEIGHT] = [320, 70];

export function showPoint(row, facts) {
  find('point').hidden = row < 0;
  if (row < 0) return;
  find('point-row').textContent = row.toLocaleString('en-US');
  find('point-facts').replaceChildren(...facts.flatMap(([name, value]) => [make('dt', {}, name), make('dd', {}, number(value, 9))]));
}

/** A curve over scales, both logarithmic, as heat kernel signatures are looked at. */
export function showCurve(values) {
  const plot = find('curve');
  plot.toggleAttribute('hidden', !values);
  if (!values) return;
  const logs = [...values].map((value) => Math.log(Math.max(value, 1e-30)));
  const [low, high] = [Math.min(...logs), Math.max(...logs)];
  const x = (i) => 6 + i / (logs.length - 1) * (WIDTH - 12);
  const y = (value) => HEIGHT - 16 - (value - low) / (high - low || 1) * (HEIGHT - 26);
  plot.setAttribute('viewBox', `0 0 ${WIDTH} ${HEIGHT}`);
  plot.replaceChildren(
    svg('title', {}, 'Heat kernel signature of the point, from short to long times'),
    svg('polyline', { points: logs.map((value, i) => `${x(i).toFixed(1)},${y(value).toFixed(1)}`).join(' ') }),
    svg('text', { x: 6, y: HEIGHT - 3 }, 'short times'),
    svg('text', { x: WIDTH - 6, y: HEIGHT - 3, 'text-anchor': 'end' }, 'long times'),
  );
}
