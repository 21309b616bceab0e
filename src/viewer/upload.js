// Bringing a scan: dropped, chosen, or the sample; with a form of what the service says it takes.

import { json, upload } from './api.js';
import { find, make, tell } from './dom.js';
import { sampleFile } from './sample.js';
import { status } from './state.js';

// The first ones are shown, the others wait behind "More".
const FIRST = ['operator', 'bases', 'tolerance'];
const NAMES_KEPT = 50;

let canceled = null;

/** The names under which clouds were uploaded from this browser: the service may not know them. */
export function names() {
  try { return JSON.parse(localStorage.getItem('chladni-names')) ?? {}; } catch { return {}; }
}

function remember(id, name) {
  const kept = Object.entries({ ...names(), [id]: name }).slice(-NAMES_KEPT);
  localStorage.setItem('chladni-names', JSON.stringify(Object.fromEntries(kept)));
}

function field({ name, type, schema = {}, default: usual, meaning, accepted }) {
  const words = schema.enum ?? (type === 'boolean' ? ['true', 'false'] : null);
  const meant = make('small', { id: `about-${name}` }, meaning.replaceAll('`', ''));
  let input;
  if (words) {
    const usualOption = words.includes(usual) ? [] : [make('option', { value: '' }, usual || 'as usual')];
    input = make('select', {}, ...usualOption, ...words.map((word) => make('option', { value: word, defaultSelected: word === usual }, word)));
  } else {
    const isNumber = type === 'number' || type === 'integer';
    input = make('input', { type: isNumber ? 'number' : 'text', placeholder: usual, title: accepted ?? '' });
    if (isNumber) {
      input.step = type === 'integer' ? 1 : 'any';
      if (schema.minimum !== undefined) input.min = schema.minimum;
      if (schema.maximum !== undefined) input.max = schema.maximum;
    }
  }
  Object.assign(input, { name, id: `parameter-${name}` });
  input.setAttribute('aria-describedby', meant.id);
  return make('label', { htmlFor: input.id }, make('span', {}, name.replaceAll('_', ' ')), input, meant);
}

/** Fills the form with the parameters that the service takes. */
export async function fillForm() {
  const { parameters, formats, limits } = await json('/capabilities');
  const form = find('parameters');
  if (form.dataset.filled) return;
  form.dataset.filled = 'yes';
  const first = FIRST.map((name) => parameters.find((one) => one.name === name)).filter(Boolean);
  const more = make('details', {}, make('summary', {}, 'More parameters'), ...parameters.filter((one) => !first.includes(one)).map(field));
  form.append(...first.map(field), more);
  const most = `up to ${limits.points_max.toLocaleString('en-US')} points`;
  find('formats').textContent = `${formats.upload.map((one) => one.name.toUpperCase()).join(', ')}; ${most}`;
}

function query() {
  const parts = new URLSearchParams();
  for (const input of find('parameters').querySelectorAll('input, select')) {
    const usual = input.tagName === 'SELECT' && [...input.options].every((option) => option.defaultSelected === option.selected);
    if (input.value !== '' && !usual) parts.set(input.name, input.value);
  }
  return parts;
}

export function cancelUpload() { canceled?.abort(); }

/** Uploads a file; `shown` gets the share that is sent, and `done` the service's answer. */
async function send(file, shown, done) {
  if (!find('parameters').reportValidity()) return;
  canceled?.abort();
  canceled = new AbortController();
  find('open').close();
  Object.assign(status, { phase: 'uploading', message: file.name, error: null });
  status.times = { dropped: performance.now() };
  tell('');
  shown(0, file.name);
  try {
    const answer = await upload(file.name, file, query(), (share) => shown(share, file.name), canceled.signal);
    remember(answer.cloud.id, file.name);
    status.times.uploaded = performance.now();
    done(answer);
  } catch (error) {
    shown(null);
    if (error.name === 'AbortError') return;
    Object.assign(status, { phase: 'failed', message: error.message, error: error.message });
    tell(`${file.name}: ${error.message}`, true);
  }
}

export function listenForFiles(shown, done) {
  const take = (file) => file && send(file, shown, done);
  const stage = document.body;
  const files = (event) => event.dataTransfer?.types.includes('Files');
  stage.addEventListener('dragover', (event) => {
    if (!files(event)) return;
    event.preventDefault();
    stage.classList.add('dropping');
  });
  stage.addEventListener('dragleave', (event) => { if (!event.relatedTarget) stage.classList.remove('dropping'); });
  stage.addEventListener('drop', (event) => {
    if (!files(event)) return;
    event.preventDefault();
    stage.classList.remove('dropping');
    take(event.dataTransfer.files[0]);
  });
  for (const button of document.querySelectorAll('[data-open]')) {
    button.addEventListener('click', async () => {
      find('open').showModal();
      await fillForm().catch((error) => tell(error.message, true));
    });
  }
  find('choose').addEventListener('click', () => { if (find('parameters').reportValidity()) find('file').click(); });
  find('file').addEventListener('change', () => { take(find('file').files[0]); find('file').value = ''; });
  for (const button of document.querySelectorAll('[data-sample]')) button.addEventListener('click', () => take(sampleFile()));
}
