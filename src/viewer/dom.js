// Making parts of the page. Text goes in as text alone: names out of files are never read as HTML.

export const find = (id) => document.getElementById(id);

export function make(name, properties = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key in element) element[key] = value; else element.setAttribute(key, value);
  }
  element.append(...children);
  return element;
}

export function svg(name, attributes = {}, ...children) {
  const element = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

/** A number with no more digits than tell something, powers of ten for the very large and small. */
export function number(value, digits = 4) {
  if (value === null || value === undefined || Number.isNaN(value)) return '–';
  if (value === 0) return '0';
  const size = Math.abs(value);
  if (size >= 1e-3 && size < 1e6) return String(+value.toPrecision(digits)).replace('-', '−');
  const [mantissa, power] = value.toExponential(digits - 2).split('e');
  return `${mantissa}e${Number(power)}`.replaceAll('-', '−');
}

export const count = (value) => value.toLocaleString('en-US');

/** Says something to those who listen instead of looking. */
export function say(text) { find('said').textContent = text; }

let hiding = 0;

/** A message that stays for a while; problems stay until they are closed. */
export function tell(text, isProblem = false) {
  clearTimeout(hiding);
  const box = find('message');
  box.hidden = !text;
  box.className = isProblem ? 'problem' : '';
  box.querySelector('p').textContent = text;
  if (text && !isProblem) hiding = setTimeout(() => { box.hidden = true; }, 4000);
}
