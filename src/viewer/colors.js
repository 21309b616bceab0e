// Colors of values: the service's own tables, and the range that they span.

import { PALETTE } from './palette.js';

// Share of the values that the colors tell apart, as in the service's pictures.
const COLORED_SHARE = 0.995;
// Stands for rows without a value: shaders may assume that NaN does not occur.
export const ABSENT = 3e38;

/** Bytes of red, green and blue out of hexadecimal digits. */
export function bytesOf(digits) {
  return Uint8Array.from(digits.match(/../g), (pair) => parseInt(pair, 16));
}

/** 256 colors, four bytes each. */
export function tableOf(kind) {
  const bytes = bytesOf(PALETTE[kind]);
  const table = new Uint8Array(bytes.length / 3 * 4).fill(255);
  for (let i = 0; i < bytes.length / 3; i += 1) table.set(bytes.subarray(3 * i, 3 * i + 3), 4 * i);
  return table;
}

/** The value that `place` others do not exceed. Hoare's selection; reorders `values`. */
function select(values, place) {
  let [low, high] = [0, values.length - 1];
  while (low < high) {
    const pivot = values[(low + high) >> 1];
    let [i, j] = [low, high];
    while (i <= j) {
      while (values[i] < pivot) i += 1;
      while (values[j] > pivot) j -= 1;
      if (i <= j) {
        [values[i], values[j]] = [values[j], values[i]];
        i += 1;
        j -= 1;
      }
    }
    if (place <= j) high = j;
    else if (place >= i) low = i;
    else break;
  }
  return values[place];
}

/** `[low, high]` of the colors: symmetric for diverging ones, without a few outliers. */
export function rangeOf(values, kind) {
  const finite = values.filter(Number.isFinite);
  if (!finite.length) return kind === 'diverging' ? [-1, 1] : [0, 1];
  const place = Math.ceil((finite.length - 1) * COLORED_SHARE);
  if (kind === 'diverging') {
    const most = select(finite.map(Math.abs), place);
    return [-most, most];
  }
  return [select(finite, finite.length - 1 - place), select(finite, place)];
}

/** For the graphics card: as single precision, NaN replaced. */
export function drawable(values) {
  const drawn = values instanceof Float32Array ? values.slice() : Float32Array.from(values);
  for (let i = 0; i < drawn.length; i += 1) if (!(Math.abs(drawn[i]) < ABSENT)) drawn[i] = ABSENT;
  return drawn;
}
