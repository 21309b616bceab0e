// Modes as they are looked at: fetched one by one, the last ones kept, the next ones fetched ahead.

import { buffer } from './api.js';
import { readNpy } from './npy.js';

const KEPT_BYTES = 256 << 20;
const KEPT_MOST = 1024;

export class Modes {
  constructor(job, count, points) {
    Object.assign(this, { job, count });
    this.most = Math.max(4, Math.min(KEPT_MOST, Math.floor(KEPT_BYTES / (4 * points))));
    this.kept = new Map();
  }

  /** Mode i, one number per row, single precision. */
  get(i) {
    const found = this.kept.get(i) ?? this.fetch(i);
    // A map lists its keys in the order in which they were put in: the first one is the longest unused.
    this.kept.delete(i);
    this.kept.set(i, found);
    while (this.kept.size > this.most) this.kept.delete(this.kept.keys().next().value);
    return found;
  }

  async fetch(i) {
    try {
      const path = `/jobs/${this.job}/bases?format=npy&dtype=f32&first=${i}&count=1`;
      return readNpy(await buffer(path)).data;
    } catch (error) {
      this.kept.delete(i);
      throw error;
    }
  }

  /** Fetches the neighbors of i; a failure is shown once its mode is looked at. */
  ahead(i) {
    for (const next of [i + 1, i - 1, i + 2]) {
      if (next >= 0 && next < this.count && !this.kept.has(next)) this.get(next).catch(() => {});
    }
  }
}
