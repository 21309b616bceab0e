// The panel: what it shows of the view, and what it changes of it.

import { find, make, number } from './dom.js';
import { gainsOf } from './filter.js';
import { change, view } from './state.js';

const PLAY_MILLISECONDS = 700;

export class Controls {
  /** `drawn` resolves once the mode that was chosen is on the screen. */
  constructor(drawn) {
    this.drawn = drawn;
    this.count = 0;
    this.playing = false;
    for (const [id, name, read] of [
      ['color', 'color', String], ['field', 'field', String], ['scale', 'scale', Number], ['up', 'up', String],
      ['projection', 'projection', String], ['features', 'features', Number], ['gain', 'gain', Number],
    ]) find(id).addEventListener('input', () => { if (find(id).checkValidity()) change({ [name]: read(find(id).value) }); });
    find('mode').addEventListener('input', () => this.choose(Number(find('mode').value)));
    find('before').addEventListener('click', () => this.step(-1));
    find('after').addEventListener('click', () => this.step(1));
    find('play').addEventListener('click', () => this.play(!this.playing));
    find('range').addEventListener('input', () => change({ range: find('range').checked ? 'fixed' : 'mode' }));
    find('fit').addEventListener('click', () => change({ zoom: 1, x: 0, y: 0 }));
    find('filter').addEventListener('input', () => this.chooseFilter());
    find('from').addEventListener('input', () => this.moveEdges('from'));
    find('to').addEventListener('input', () => this.moveEdges('to'));
    find('outside').addEventListener('input', () => change({ outside: find('outside').value === '' ? -1 : Math.max(0, Number(find('outside').value)) }));
  }

  choose(basis) {
    change({ color: 'basis', basis: Math.min(Math.max(basis, 0), this.count - 1) });
  }

  step(by) { if (this.count) this.choose((view.basis + by + this.count) % this.count); }

  async play(on) {
    this.playing = on;
    find('play').setAttribute('aria-pressed', on);
    find('play').textContent = on ? '❚❚' : '▶';
    while (this.playing) {
      this.step(1);
      await Promise.all([this.drawn(), new Promise((resolve) => { setTimeout(resolve, PLAY_MILLISECONDS); })]);
    }
  }

  chooseFilter() {
    const filter = find('filter').value;
    const fresh = view.filter === '';
    const to = Math.max(2, Math.round(this.count / 5));
    change(fresh ? { filter, from: 0, to, outside: -1 } : { filter, outside: -1 });
  }

  /** The handles do not pass each other. */
  moveEdges(moved) {
    let [from, to] = [Number(find('from').value), Number(find('to').value)];
    if (from >= to) { if (moved === 'from') from = to - 1; else to = from + 1; }
    change({ from: Math.max(from, 0), to });
  }

  /** Sections and ranges for a cloud, with or without modes. */
  offer(cloud, modes, choices) {
    this.count = modes;
    this.play(false);
    for (const id of ['spectrum-section', 'filter-section', 'features-section', 'transport']) find(id).hidden = !modes;
    for (const id of ['color-section', 'view-section']) find(id).hidden = false;
    find('color').replaceChildren(...choices.map(([value, text]) => make('option', { value }, text)));
    find('field').replaceChildren(...cloud.fieldNames.map((name) => make('option', { value: name }, name)));
    find('mode').max = modes - 1;
    find('from').max = Math.max(modes - 1, 0);
    find('to').max = modes;
  }

  /** What the view says, in the controls. */
  show() {
    find('color').value = view.color;
    find('field').value = view.field;
    find('field-label').hidden = view.color !== 'field';
    find('scale-label').hidden = view.color !== 'hks' && view.color !== 'wks';
    find('scale').value = view.scale;
    find('range').checked = view.range === 'fixed';
    find('mode').value = view.basis;
    find('mode-number').textContent = view.color === 'basis' ? `${view.basis} / ${this.count - 1}` : '';
    find('up').value = view.up;
    find('projection').value = view.projection;
    find('features').value = view.features;
    this.showFilter();
  }

  showFilter() {
    const { filter, from, to } = view;
    find('filter').value = filter;
    find('filter-form').hidden = !filter;
    if (!filter) return;
    const isBand = filter.startsWith('band') || filter === 'enhance';
    find('from-label').hidden = !isBand;
    find('gain-label').hidden = filter !== 'enhance';
    find('to-name').textContent = isBand ? 'to mode' : 'cut-off';
    find('from').value = from;
    find('to').value = to < 0 ? this.count : to;
    find('gain').value = view.gain;
    find('outside').value = view.outside < 0 ? '' : view.outside;
    const { gains, outside } = gainsOf(view, this.count);
    const kept = gains.filter((gain) => gain > 0).length;
    find('filter-facts').textContent = `${kept} of ${this.count} modes pass; what lies outside of them × ${number(outside)}`;
  }
}
