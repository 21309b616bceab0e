// The color bar: what is shown, between which values.

import { bytesOf } from './colors.js';
import { find, number } from './dom.js';
import { PALETTE } from './palette.js';

/** Draws a table of colors from left to right. */
export function drawBar(canvas, kind) {
  const pen = canvas.getContext('2d');
  const bytes = bytesOf(PALETTE[kind]);
  canvas.width = bytes.length / 3;
  canvas.height = 1;
  for (let i = 0; i < canvas.width; i += 1) {
    pen.fillStyle = `rgb(${bytes[3 * i]},${bytes[3 * i + 1]},${bytes[3 * i + 2]})`;
    pen.fillRect(i, 0, 1, 1);
  }
}

/** `what` is `{title, unit, kind, low, high, absent}`; null when the colors stand for nothing. */
export function showLegend(what) {
  const legend = find('legend');
  legend.hidden = !what;
  if (!what) return;
  find('legend-title').textContent = what.title;
  find('legend-unit').textContent = what.unit;
  const isTable = what.kind === 'diverging' || what.kind === 'sequential';
  find('legend-scale').hidden = !isTable;
  if (isTable) {
    drawBar(find('legend-bar'), what.kind);
    find('legend-low').textContent = number(what.low, 3);
    find('legend-middle').textContent = what.kind === 'diverging' ? '0' : number((what.low + what.high) / 2, 3);
    find('legend-high').textContent = number(what.high, 3);
  }
  find('legend-absent').hidden = !what.absent;
}
