// Filters applied while a handle moves: x' = outside · x + Σ (gain_i − outside) c_i h_i, of which a move changes few terms.

import { json, request } from './api.js';
import { readNpy, writeNpy } from './npy.js';

/** The gain of every mode and of what lies outside of them, as the service's filters have them. */
export function gainsOf({ filter, from, to, gain, outside }, count) {
  const end = to < 0 ? count : to;
  const inside = { 'low-pass': 1, 'high-pass': 0, 'band-pass': 1, 'band-stop': 0, enhance: gain }[filter];
  const beside = { 'low-pass': 0, 'high-pass': 1, 'band-pass': 0, 'band-stop': 1, enhance: 1 }[filter];
  const first = filter === 'low-pass' || filter === 'high-pass' ? 0 : from;
  const gains = Float64Array.from({ length: count }, (_, i) => (i >= first && i < end ? inside : beside));
  return { gains, outside: outside < 0 ? beside : outside };
}

/** The same filter as arguments of the service. */
export function argumentsOf({ filter, from, to, gain, outside }, count) {
  const end = to < 0 ? count : to;
  const parts = new URLSearchParams({ filter, by: 'mode' });
  if (filter === 'low-pass' || filter === 'high-pass') parts.set('cutoff', end);
  else { parts.set('from', from); parts.set('to', end); }
  if (filter === 'enhance') parts.set('gain', gain);
  parts.set('outside', gainsOf({ filter, from, to, gain, outside }, count).outside);
  return parts;
}

export class LiveFilter {
  /** `positions` are recentered by `center`; `modes` are those of the job. */
  constructor(job, modes, positions, center) {
    Object.assign(this, { job, modes, positions, center });
    this.applied = new Float64Array(modes.count);
    this.outside = 1;
    this.sums = Float64Array.from(positions);
    this.turn = 0;
  }

  /** Coefficients of the recentered coordinates, three per mode. What the center takes away is the transform of ones. */
  async prepare() {
    const fields = (await json(`/jobs/${this.job}/coefficients?format=json`)).fields;
    const ones = writeNpy(new Float32Array(this.positions.length / 3).fill(1));
    const options = { method: 'POST', body: ones, headers: { 'Content-Type': 'application/x-npy' } };
    const answer = await request(`/jobs/${this.job}/coefficients?format=npy`, options);
    const ofOnes = readNpy(await answer.arrayBuffer()).data;
    this.coefficients = new Float64Array(3 * this.modes.count);
    ['x', 'y', 'z'].forEach((name, axis) => {
      fields[name]?.forEach((c, i) => { this.coefficients[3 * i + axis] = c - this.center[axis] * ofOnes[i]; });
    });
  }

  /** Brings the sums to these gains mode by mode; `seen` is called after each. False when a later call took over. */
  async apply({ gains, outside }, seen) {
    this.turn += 1;
    const turn = this.turn;
    // What becomes of the center, which is constant: its place is not drawn.
    [this.ofCenter] = gains;
    this.preparing ??= this.prepare();
    await this.preparing;
    if (turn !== this.turn) return false;
    if (outside !== this.outside) this.restart(outside);
    const changed = [...gains.keys()].filter((i) => gains[i] - outside !== this.applied[i]);
    // From scratch when that is fewer modes than to go on from here.
    if (changed.length > gains.filter((gain) => gain !== outside).length) {
      this.restart(outside);
      changed.splice(0, Infinity, ...[...gains.keys()].filter((i) => gains[i] !== outside));
    }
    if (changed.length) this.modes.get(changed[0]).catch(() => {});
    for (const [place, i] of changed.entries()) {
      changed.slice(place + 1, place + 4).forEach((next) => this.modes.get(next).catch(() => {}));
      const mode = await this.modes.get(i);
      if (turn !== this.turn) return false;
      this.add(mode, i, gains[i] - outside - this.applied[i]);
      this.applied[i] = gains[i] - outside;
      seen(place + 1, changed.length);
    }
    return true;
  }

  restart(outside) {
    this.outside = outside;
    this.applied.fill(0);
    for (let i = 0; i < this.sums.length; i += 1) this.sums[i] = outside * this.positions[i];
  }

  add(mode, i, weight) {
    const [cx, cy, cz] = [0, 1, 2].map((axis) => weight * this.coefficients[3 * i + axis]);
    const { sums } = this;
    for (let row = 0; row < mode.length; row += 1) {
      const h = mode[row];
      sums[3 * row] += cx * h;
      sums[3 * row + 1] += cy * h;
      sums[3 * row + 2] += cz * h;
    }
  }

  /** Positions of now; rows without a result stay where they are. */
  moved() {
    const moved = Float32Array.from(this.sums);
    for (let i = 0; i < moved.length; i += 1) if (Number.isNaN(moved[i])) moved[i] = this.positions[i];
    return moved;
  }
}
