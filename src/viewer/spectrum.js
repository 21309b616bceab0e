// The spectrum as a plot: click a mode, see its cluster, its residual, Weyl's line, and the band of a filter.

import { find, number, svg } from './dom.js';

const [WIDTH, HEIGHT] = [320, 150];
const [LEFT, RIGHT, TOP, BOTTOM] = [44, 8, 8, 24];

export class SpectrumPlot {
  constructor(element, choose) {
    this.element = element;
    this.choose = choose;
    element.setAttribute('viewBox', `0 0 ${WIDTH} ${HEIGHT}`);
    element.addEventListener('click', (event) => { if (this.spectrum) choose(this.at(event)); });
    element.addEventListener('pointermove', (event) => { if (this.spectrum) this.hover(this.at(event)); });
    element.addEventListener('pointerleave', () => this.hover(this.mode));
  }

  at(event) {
    const box = this.element.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width * WIDTH;
    const share = (x - LEFT) / (WIDTH - LEFT - RIGHT);
    return Math.min(this.last, Math.max(0, Math.round(share * this.last)));
  }

  x(i) { return LEFT + i / Math.max(this.last, 1) * (WIDTH - LEFT - RIGHT); }
  y(value) { return HEIGHT - BOTTOM - (value - this.low) / (this.high - this.low) * (HEIGHT - TOP - BOTTOM); }

  show(spectrum) {
    this.spectrum = spectrum;
    const values = spectrum.eigenvalues;
    this.last = values.length - 1;
    const known = values.filter((value) => value !== null);
    this.low = Math.min(0, ...known);
    this.high = Math.max(...known, this.low) || 1;
    this.band = svg('rect', { class: 'band', y: TOP, height: HEIGHT - TOP - BOTTOM, width: 0 });
    this.cursor = svg('line', { class: 'cursor', y1: TOP, y2: HEIGHT - BOTTOM });
    this.dot = svg('circle', { class: 'here', r: 3.5 });
    this.element.replaceChildren(this.band, ...this.axes(), ...this.weyl(), ...this.clusters(), ...this.dots(), this.cursor, this.dot);
  }

  axes() {
    const bottom = HEIGHT - BOTTOM;
    const text = (x, y, anchor, words) => svg('text', { x, y, 'text-anchor': anchor }, words);
    const ticks = [0, 0.5, 1].flatMap((share) => {
      const value = this.low + share * (this.high - this.low);
      return [text(LEFT - 5, this.y(value) + 3, 'end', number(value, 3)), svg('line', { class: 'grid', x1: LEFT, x2: WIDTH - RIGHT, y1: this.y(value), y2: this.y(value) })];
    });
    return [...ticks, text(LEFT, bottom + 14, 'start', '0'), text(WIDTH - RIGHT, bottom + 14, 'end', this.last),
      text((LEFT + WIDTH - RIGHT) / 2, bottom + 14, 'middle', 'mode'), text(LEFT + 6, TOP + 10, 'start', 'λ in 1/length²')];
  }

  /** λ = 4πn/area [Weyl 1911]. */
  weyl() {
    const area = this.spectrum.area?.cells;
    if (!area || !this.spectrum.invariants) return [];
    const slope = 4 * Math.PI / area;
    const end = Math.min(this.last, this.high / slope);
    return [svg('line', { class: 'weyl', x1: this.x(0), y1: this.y(0), x2: this.x(end), y2: this.y(end * slope) })];
  }

  clusters() {
    const { eigenvalues, clusters = [] } = this.spectrum;
    const joined = clusters.filter(([first, last]) => eigenvalues[first] !== null && eigenvalues[last] !== null);
    return joined.map(([first, last]) => svg('line', {
      class: 'cluster', x1: this.x(first), y1: this.y(eigenvalues[first]), x2: this.x(last), y2: this.y(eigenvalues[last]),
    }));
  }

  dots() {
    const radius = this.last > 200 ? 1 : 1.8;
    return this.spectrum.eigenvalues.flatMap((value, i) => (value === null ? [] : [svg('circle', { cx: this.x(i), cy: this.y(value), r: radius })]));
  }

  chosen(mode) {
    this.mode = mode;
    const value = this.spectrum?.eigenvalues[mode] ?? null;
    if (!this.dot) return;
    this.dot.setAttribute('cx', this.x(mode));
    this.dot.setAttribute('cy', this.y(value ?? 0));
    this.dot.style.display = value === null ? 'none' : '';
    for (const end of ['x1', 'x2']) this.cursor.setAttribute(end, this.x(mode));
    this.hover(mode);
  }

  shade(from, to) {
    if (!this.band) return;
    this.band.setAttribute('x', this.x(Math.max(from - 0.5, 0)));
    this.band.setAttribute('width', Math.max(0, this.x(Math.min(to - 0.5, this.last)) - this.x(Math.max(from - 0.5, 0))));
  }

  hover(mode) {
    if (mode === undefined || !this.spectrum) return;
    const { eigenvalues, residuals, clusters = [] } = this.spectrum;
    const cluster = clusters.find(([first, last]) => mode >= first && mode <= last);
    const words = [`mode ${mode}: λ = ${number(eigenvalues[mode], 6)}`, `residual ${number(residuals?.[mode], 2)}`];
    if (eigenvalues[mode] > 0) words.push(`wavelength ${number(2 * Math.PI / Math.sqrt(eigenvalues[mode]))}`);
    if (cluster) words.push(`one cluster with modes ${cluster[0]} to ${cluster[1]}`);
    find('mode-facts').textContent = words.join(' · ');
  }
}
