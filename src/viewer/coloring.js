// What the points are colored by: fetches the numbers, names them and their unit.

import { buffer } from './api.js';
import { rowOf } from './cloud.js';
import { number } from './dom.js';
import { readNpy } from './npy.js';

export const SCALES = 16;
const SIGNATURES = { hks: 'heat kernel signature', wks: 'wave kernel signature' };

export class Coloring {
  constructor(cloud, job, modes, spectrum) {
    Object.assign(this, { cloud, job, modes, spectrum, signatures: {}, distances: {} });
  }

  /** What can be shown, with a name for each. */
  choices() {
    const ofJob = this.modes
      ? [['basis', 'modes'], ['hks', SIGNATURES.hks], ['wks', SIGNATURES.wks], ['distance', 'distance from the picked point']] : [];
    const own = this.cloud.hasColors ? [['rgb', 'colors of the scan']] : [];
    return [...ofJob, ...own, ...(this.cloud.fieldNames.length ? [['field', 'a field of the scan']] : []), ['plain', 'shape alone']];
  }

  /** `{kind, values, title, unit}` of a view. */
  async of(view) {
    const can = this.choices().some(([name]) => name === view.color);
    const color = can ? view.color : 'plain';
    if (color === 'basis') return this.mode(view.basis);
    if (color === 'hks' || color === 'wks') return this.signature(color, view.scale);
    if (color === 'distance' && view.row >= 0) return this.distance(view.row);
    if (color === 'field') return this.field(view.field || this.cloud.fieldNames[0]);
    if (color === 'rgb') return { kind: 'own', own: await this.cloud.colors(), title: 'colors of the scan', unit: '' };
    return { kind: 'plain', title: '', unit: '' };
  }

  async mode(i) {
    const values = await this.modes.get(i);
    this.modes.ahead(i);
    const eigenvalue = this.spectrum.eigenvalues[i];
    return { kind: 'diverging', values, title: `mode ${i}, λ = ${number(eigenvalue, 5)}`, unit: '1/length', eigenvalue };
  }

  async signature(kind, scale) {
    this.signatures[kind] ??= buffer(this.signaturePath(kind)).then(readNpy).catch((error) => {
      delete this.signatures[kind];
      throw error;
    });
    const { shape: [rows, columns], data } = await this.signatures[kind];
    const column = Math.min(scale, columns - 1);
    const values = new Float32Array(rows);
    for (let row = 0; row < rows; row += 1) values[row] = data[row * columns + column];
    return { kind: 'sequential', values, title: `${SIGNATURES[kind]}, scale ${column + 1} of ${columns}`, unit: '1/length²' };
  }

  signaturePath(kind) { return `/jobs/${this.job.id}/signatures?kind=${kind}&count=${SCALES}&format=npy`; }

  /** The heat kernel signature of one row, short times first. */
  curve(row) { return rowOf(this.signaturePath('hks'), row); }

  async distance(row) {
    const values = readNpy(await buffer(`/jobs/${this.job.id}/distances?from=${row}&format=npy`)).data;
    return { kind: 'sequential', values, title: `biharmonic distance from row ${row}`, unit: 'length' };
  }

  async field(name) {
    return { kind: 'sequential', values: await this.cloud.field(name), title: name, unit: '' };
  }
}
