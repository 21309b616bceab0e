// A cloud as the service has it: recentered points, faces, fields, single rows.

import { buffer, json } from './api.js';
import { numbers, readNpy, readNpyHead, readPlyFaces, readPlyField, readPlyHead } from './npy.js';

// Bytes that the head of a PLY file lies within, unless it has very many properties.
const HEAD_BYTES = 1 << 16;

const part = (path, from, to) => buffer(path, { headers: { Range: `bytes=${from}-${to - 1}` } });

export class Cloud {
  constructor(record) {
    Object.assign(this, { record, id: record.id, rows: record.points, dimension: record.dimension });
    const { minimum, maximum } = record.bounding_box;
    this.center = [0, 1, 2].map((axis) => 0.5 * ((minimum[axis] ?? 0) + (maximum[axis] ?? 0)) || 0);
    this.ply = `/clouds/${this.id}/points?format=ply`;
  }

  static async load(id) { return new Cloud(await json(`/clouds/${id}`)); }

  /** Three coordinates per row, recentered in double precision before they become single. */
  async points() {
    const { data } = readNpy(await buffer(`/clouds/${this.id}/points?format=npy`));
    const positions = new Float32Array(3 * this.rows);
    for (let row = 0; row < this.rows; row += 1) {
      for (let axis = 0; axis < Math.min(this.dimension, 3); axis += 1) {
        positions[3 * row + axis] = data[this.dimension * row + axis] - this.center[axis];
      }
    }
    return positions;
  }

  head() {
    this.layout ??= part(this.ply, 0, HEAD_BYTES).then(readPlyHead);
    return this.layout;
  }

  /** Corners of triangles; null for a cloud without faces. */
  async faces() {
    if (!this.record.faces) return null;
    const layout = await this.head();
    return readPlyFaces(await part(this.ply, layout.facesAt, Number.MAX_SAFE_INTEGER), layout);
  }

  /** Coordinates in PLY, before the fields: their names there may be others, for PLY has no spaces in names. */
  get axes() { return Math.max(this.dimension, 3); }

  get fieldNames() { return this.record.fields.map((field) => field.name); }

  async field(name) {
    const layout = await this.head();
    this.whole ??= buffer(this.ply).catch((error) => { this.whole = null; throw error; });
    return readPlyField(await this.whole, layout, layout.properties[this.axes + this.fieldNames.indexOf(name)]);
  }

  get hasColors() { return ['red', 'green', 'blue'].every((name) => this.fieldNames.includes(name)); }

  /** The colors of the upload, three bytes per row. */
  async colors() {
    const channels = await Promise.all(['red', 'green', 'blue'].map((name) => this.field(name)));
    const kind = this.record.fields.find((field) => field.name === 'red').kind ?? '';
    const most = /16/.test(kind) ? 65535 : /float/.test(kind) ? 1 : 255;
    const bytes = new Uint8Array(3 * this.rows);
    channels.forEach((channel, i) => channel.forEach((value, row) => { bytes[3 * row + i] = Math.min(255, Math.max(0, 255 * value / most)); }));
    return bytes;
  }

  /** Everything that the upload says of a row, by name. */
  async row(row) {
    const layout = await this.head();
    const at = layout.begin + row * layout.stride;
    const data = new DataView(await part(this.ply, at, at + layout.stride));
    return layout.properties.map(({ name, offset, read }, i) => [this.fieldNames[i - this.axes] ?? name, data[read](offset, true)]);
  }
}

/** A row of a result with some numbers per row. */
export async function rowOf(path, row) {
  const { begin, size, shape } = readNpyHead(await part(path, 0, 256));
  const bytes = size * shape[1];
  return numbers(await part(path, begin + bytes * row, begin + bytes * (row + 1)), 0, size);
}
