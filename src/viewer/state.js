// What is shown, and its address: the fragment has the names of the service's own arguments, so that a view is a picture's address.

const DEFAULTS = {
  job: '', cloud: '', color: 'basis', basis: -1, scale: 0, field: '', row: -1,
  azimuth: -60, elevation: 20, up: 'z', zoom: 1, x: 0, y: 0, projection: 'orthographic', range: 'mode', features: 0,
  filter: '', from: 0, to: -1, gain: 2, outside: -1,
};
const WORDS = {
  color: ['basis', 'hks', 'wks', 'distance', 'field', 'rgb', 'plain'],
  up: ['x', 'y', 'z'], projection: ['orthographic', 'perspective'], range: ['mode', 'fixed'],
  filter: ['', 'low-pass', 'high-pass', 'band-pass', 'band-stop', 'enhance'],
};
const BOUNDS = { azimuth: [-360, 360], elevation: [-90, 90], zoom: [0.02, 500], x: [-10, 10], y: [-10, 10] };
const WHOLE = new Set(['basis', 'scale', 'row', 'features', 'from', 'to']);
const ID = /^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$/i;

export const view = { ...DEFAULTS };

// What tests and people in the console may look at; everything in it is plain data.
export const status = {
  phase: 'start', message: '', job: null, points: 0, drawn: 0, faces: 0, modes: 0, mode: null, eigenvalue: null,
  coloring: '', low: 0, high: 0, picked: null, features: 0, filtered: false, filter: null, frames: 0, frameMilliseconds: 0,
  refined: false, key: false, warnings: [], error: null, busy: 0, times: {},
};

const listeners = new Set();
let scheduled = 0;

export function onChange(listener) { listeners.add(listener); }

/** Changes the view, tells whoever listens, and writes the address once the change has come to rest. */
export function change(parts) {
  let differs = false;
  for (const [name, value] of Object.entries(parts)) {
    if (view[name] !== value) { view[name] = value; differs = true; }
  }
  if (!differs) return;
  for (const listener of listeners) listener(parts);
  clearTimeout(scheduled);
  scheduled = setTimeout(writeAddress, 150);
}

export function fragment() {
  const parts = new URLSearchParams();
  for (const [name, value] of Object.entries(view)) {
    if (value !== DEFAULTS[name]) parts.set(name, typeof value === 'number' ? String(+value.toPrecision(6)) : value);
  }
  return parts.toString();
}

export function writeAddress() {
  clearTimeout(scheduled);
  const address = fragment();
  if (location.hash.slice(1) !== address) {
    history.replaceState(null, '', address ? `#${address}` : location.pathname);
  }
}

/** The view that a fragment describes; what it cannot mean has its default. */
export function read(text) {
  const found = { ...DEFAULTS };
  for (const [name, value] of new URLSearchParams(text)) {
    if (!(name in DEFAULTS)) continue;
    if (typeof DEFAULTS[name] !== 'number') {
      const fits = WORDS[name] ? WORDS[name].includes(value) : name === 'field' || ID.test(value);
      if (fits) found[name] = value;
      continue;
    }
    const [least, most] = BOUNDS[name] ?? [-1, 1e9];
    const number = WHOLE.has(name) ? Math.round(value) : Number(value);
    if (value !== '' && Number.isFinite(number)) found[name] = Math.min(Math.max(number, least), most);
  }
  return found;
}

export function reset(parts) {
  Object.assign(view, DEFAULTS, parts);
  writeAddress();
}
