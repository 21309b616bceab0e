// A cloud and a job on the stage: loads them, colors the points, filters them, marks features, picks.

import { json } from './api.js';
import { ballAround } from './camera.js';
import { Cloud } from './cloud.js';
import { Coloring } from './coloring.js';
import { drawable, rangeOf } from './colors.js';
import { count, find, make, number, say, tell } from './dom.js';
import { LiveFilter, gainsOf } from './filter.js';
import { showLegend } from './legend.js';
import { Modes } from './modes.js';
import { showCurve, showPoint } from './point.js';
import { change, status, view } from './state.js';
import { normalsAfterMove, surfaceOf } from './surface.js';

const FEATURES_MOST = 40;

/** The recentered points of a cloud, on the stage at once; sizes, normals and faces follow. */
export class Session {
  constructor(cloud, positions, scene, renderer) {
    Object.assign(this, { cloud, positions, scene, renderer, job: null, modes: null, spectrum: null, turn: 0, pickTurn: 0, current: null, fixed: {} });
    this.coloring = new Coloring(cloud, null, null, null);
  }

  static async open(id, scene, renderer) {
    const cloud = await Cloud.load(id);
    const positions = await cloud.points();
    return new Session(cloud, positions, scene, renderer);
  }

  get modeCount() { return this.modes?.count ?? 0; }

  async show() {
    const ball = ballAround(this.positions);
    Object.assign(status, { points: this.cloud.rows, faces: 0, refined: false, modes: 0, mode: null, eigenvalue: null, picked: null, features: 0, filtered: false });
    if (!this.scene) return;
    // About that of a ball's surface evenly sampled.
    this.scene.setPoints(this.positions, ball, 1.6 * ball.radius / Math.sqrt(this.cloud.rows));
    await this.renderer.drawn();
    this.refining = this.refine();
    this.refining.catch((error) => tell(error.message, true));
  }

  async refine() {
    const faces = await this.cloud.faces();
    const { normals, radii } = await surfaceOf(this.positions, faces);
    if (this.closed) return;
    this.scene.set('normals', normals);
    this.scene.set('radii', radii);
    if (faces) this.scene.set('faces', faces);
    await this.renderer.drawn();
    status.faces = (faces?.length ?? 0) / 3;
    status.refined = true;
  }

  /** The results of a job that has succeeded. */
  async take(job) {
    this.job = job;
    if (job.kind === 'eigen') {
      this.spectrum = await json(`/jobs/${job.id}/spectrum?format=json`);
      this.modes = new Modes(job.id, this.spectrum.eigenvalues.length, this.cloud.rows);
    }
    this.coloring = new Coloring(this.cloud, job, this.modes, this.spectrum);
    Object.assign(status, { modes: this.modeCount, warnings: job.warnings });
    if (view.basis < 0 || view.basis >= this.modeCount) view.basis = Math.min(this.spectrum?.components ?? 1, Math.max(this.modeCount - 1, 0));
  }

  /** Colors the points by what the view says; the last call wins. */
  async color() {
    this.turn += 1;
    const { turn } = this;
    const began = performance.now();
    status.busy += 1;
    try {
      const what = await this.coloring.of(view);
      if (turn !== this.turn || this.closed) return;
      this.paint(what);
      await this.renderer.drawn();
      Object.assign(status, { coloring: what.title, low: this.scene.paint.low, high: this.scene.paint.high, mode: what.eigenvalue === undefined ? null : view.basis, eigenvalue: what.eigenvalue ?? null });
      status.times.coloring = performance.now() - began;
    } finally {
      status.busy -= 1;
    }
  }

  paint(what) {
    this.current = what;
    this.scene.set('own', what.own ?? null);
    this.scene.set('values', what.values ? drawable(what.values) : null);
    const [low, high] = what.values ? this.rangeOf(what) : [0, 1];
    this.scene.paint = { kind: what.kind, low, high };
    this.legend = what.kind === 'plain' ? null : { ...what, low, high, absent: what.values?.some(Number.isNaN) };
    showLegend(this.legend);
    if (what.title) say(what.title);
    if (view.row >= 0) this.showValue();
  }

  /** Of these values, or kept from the first that were colored in this way. */
  rangeOf(what) {
    const own = rangeOf(what.values, what.kind);
    if (view.range === 'mode') this.fixed = {};
    else this.fixed[view.color] ??= own;
    return this.fixed[view.color] ?? own;
  }

  /** Moves the points as the filter says, mode by mode. */
  async filter() {
    if (!this.modes || (!view.filter && !this.live)) return;
    this.live ??= new LiveFilter(this.job.id, this.modes, this.positions, this.cloud.center);
    const gains = view.filter ? gainsOf(view, this.modeCount) : { gains: new Float64Array(this.modeCount).fill(1), outside: 1 };
    const began = performance.now();
    status.busy += 1;
    try {
      const complete = await this.live.apply(gains, (done, of) => { if (done % 8 === 0 && done < of) this.move(); });
      if (!complete || this.closed) return;
      this.move();
      await this.renderer.drawn();
      Object.assign(status, { filtered: Boolean(view.filter), filter: view.filter ? { kind: view.filter, from: view.from, to: view.to } : null });
      status.times.filter = performance.now() - began;
      this.renew();
    } finally {
      status.busy -= 1;
    }
  }

  move() {
    this.moved = this.live.moved();
    this.scene.set('positions', this.moved);
    this.mark();
    this.renderer.redraw();
  }

  /** Normals follow once the points are at rest. */
  async renew() {
    const { moved } = this;
    await this.refining;
    const normals = await normalsAfterMove(moved);
    if (moved !== this.moved || this.closed) return;
    this.scene.set('normals', normals);
    this.renderer.redraw();
  }

  async features() {
    if (!this.modes) return;
    if (view.features && !this.found) {
      this.found = json(`/jobs/${this.job.id}/features?format=json&limit=${FEATURES_MOST}`).then((answer) => answer.features);
    }
    this.marks = view.features ? (await this.found).slice(0, view.features) : [];
    if (this.closed) return;
    find('feature-list').replaceChildren(...this.marks.map(({ index, persistence }, i) => make('li', {}, make('button', {
      type: 'button', title: `row ${index}, persistence ${number(persistence, 3)}`, onclick: () => change({ row: index }),
    }, String(i + 1)))));
    this.mark();
    await this.renderer.drawn();
    status.features = this.marks.length;
  }

  /** Marks of features by their rank, and a ring around the picked point. */
  mark() {
    const positions = this.moved ?? this.positions;
    const at = (row, label) => [...positions.subarray(3 * row, 3 * row + 3), label];
    const marks = (this.marks ?? []).map(({ index }, i) => at(index, i + 1));
    if (view.row >= 0 && view.row < this.cloud.rows) marks.push(at(view.row, -1));
    this.scene.set('marks', marks.length ? Float32Array.from(marks.flat()) : null);
    this.renderer.redraw();
  }

  /** Picks what is seen at a place of the canvas, in its own pixels. */
  pick(x, y) {
    const { canvas } = this.scene;
    const found = this.scene.pick(view, (x + 0.5) / canvas.clientWidth * canvas.width, (y + 0.5) / canvas.clientHeight * canvas.height);
    this.seen = found;
    change({ row: found?.row ?? -1 });
    status.picked = found;
  }

  /** What is known of the picked row. */
  async point() {
    this.pickTurn += 1;
    const { pickTurn } = this;
    this.mark();
    const { row } = view;
    if (row < 0 || row >= this.cloud.rows) { showPoint(-1); status.picked = null; return; }
    status.picked = { color: null, ...(this.seen?.row === row ? this.seen : {}), row };
    this.facts = [];
    this.showValue();
    showCurve(null);
    const facts = await this.cloud.row(row);
    if (pickTurn !== this.pickTurn) return;
    this.facts = facts;
    status.picked.facts = Object.fromEntries(facts);
    this.showValue();
    if (this.modes) {
      const curve = await this.coloring.curve(row);
      if (pickTurn === this.pickTurn && curve.every(Number.isFinite)) { showCurve(curve); status.picked.curve = [...curve]; }
    }
  }

  showValue() {
    const value = this.current?.values?.[view.row];
    if (status.picked) status.picked.value = value ?? null;
    showPoint(view.row, value === undefined ? this.facts ?? [] : [...(this.facts ?? []), [this.current.title, value]]);
  }

  get title() { return `${count(this.cloud.rows)} points${this.cloud.record.faces ? `, ${count(this.cloud.record.faces)} triangles` : ''}`; }

  close() { this.closed = true; }
}
