// Wires the page: what is asked for by the address, by hand, and by a dropped file.

import { download, ended, hasKey, json, onKeyNeeded, saveBlob } from './api.js';
import { Controls } from './controls.js';
import { find, make, number, tell } from './dom.js';
import { showPicture } from './fallback.js';
import { argumentsOf } from './filter.js';
import { showProgress, unwatch, watch } from './follow.js';
import { listen } from './gestures.js';
import { curl, link, pageOf, picture, savePage, savePicture } from './keep.js';
import { showLegend } from './legend.js';
import { listLast, nameOf } from './list.js';
import { Renderer } from './render.js';
import { Scene } from './scene.js';
import { Session } from './session.js';
import { SpectrumPlot } from './spectrum.js';
import { change, fragment, onChange, read, reset, status, view, writeAddress } from './state.js';
import { cancelUpload, fillForm, listenForFiles } from './upload.js';

const canvas = find('canvas');
let scene = null;
let renderer = null;
try {
  scene = new Scene(canvas);
  renderer = new Renderer(scene);
} catch (error) {
  canvas.hidden = true;
  status.message = error.message;
}
let session = null;
let loading = 0;

const controls = new Controls(() => session?.coloringNow ?? Promise.resolve());
const plot = new SpectrumPlot(find('spectrum'), (mode) => controls.choose(mode));

/** Runs something that may fail, and tells why it did. */
async function attempt(work) {
  try {
    return await work();
  } catch (error) {
    if (error.name === 'AbortError') return null;
    status.error = error.message;
    if (error.status === 404) status.phase = 'gone';
    tell(error.message, true);
    return null;
  }
}

/** Opens what the view names, and follows its job to the end. */
async function open() {
  loading += 1;
  const turn = loading;
  session?.close();
  unwatch();
  showLegend(null);
  Object.assign(status, { phase: 'loading', error: null, job: null, coloring: '' });
  if (view.job) {
    const job = await json(`/jobs/${view.job}`);
    view.cloud = job.cloud_id;
    status.job = { id: job.id, state: job.state, progress: job.progress };
    await stage(turn, job);
  } else {
    await stage(turn, null);
  }
}

async function stage(turn, job) {
  find('welcome').hidden = true;
  const opened = await Session.open(view.cloud, scene, renderer);
  if (turn !== loading) return;
  session = opened;
  const name = nameOf(session.cloud.record);
  document.title = `${name} · chladni`;
  find('title').textContent = `${name} · ${session.title}`;
  await session.show();
  status.times.firstFrame = performance.now() - (status.times.dropped ?? 0);
  controls.offer(session.cloud, 0, session.coloring.choices());
  controls.show();
  if (!job) {
    await finish(turn);
    return;
  }
  const last = ended(job) ? job : await watch(job, name);
  if (!last || turn !== loading) return;
  status.job = { id: last.id, state: last.state, progress: last.progress };
  if (last.state !== 'succeeded') {
    const why = last.error?.detail ?? 'the job was canceled';
    Object.assign(status, { phase: last.state, error: why });
    tell(why, last.state === 'failed');
    return;
  }
  await session.take(last);
  controls.offer(session.cloud, session.modeCount, session.coloring.choices());
  if (session.spectrum) showTrust(session);
  await finish(turn);
}

async function finish(turn) {
  controls.show();
  writeAddress();
  if (!scene) {
    await showPicture(session.modeCount);
  } else {
    await colored();
    status.times.firstMode = performance.now() - (status.times.dropped ?? 0);
    await Promise.all([session.features(), session.filter(), session.point()]);
  }
  if (turn === loading) status.phase = 'ready';
  attempt(() => listLast(choose));
}

function colored() {
  session.coloringNow = session.color();
  return session.coloringNow;
}

/** How far the modes can be trusted, in words. */
function showTrust({ spectrum, job }) {
  plot.show(spectrum);
  plot.chosen(view.basis);
  if (view.filter) plot.shade(view.from, view.to < 0 ? spectrum.eigenvalues.length : view.to);
  const { certificates, residuals, area } = spectrum;
  const facts = [`largest residual ${number(Math.max(...residuals), 2)}`];
  if (certificates?.orthogonality !== undefined) facts.push(`orthogonal within ${number(certificates.orthogonality, 2)}`);
  if (Number.isFinite(certificates?.missed)) facts.push(`${certificates.missed} modes missed`);
  if (area?.cells) facts.push(`area ${number(area.cells)}`);
  find('trust').textContent = facts.join(' · ');
  find('warnings').replaceChildren(...job.warnings.map((warning) => make('li', {}, warning)));
}

function choose(parts) {
  reset(parts);
  attempt(open);
}

onChange((parts) => {
  if (!session) return;
  controls.show();
  if (!scene) { attempt(() => showPicture(session.modeCount)); return; }
  const has = (...names) => names.some((name) => name in parts);
  if (has('basis')) plot.chosen(view.basis);
  if (has('color', 'basis', 'scale', 'field', 'range') || (has('row') && view.color === 'distance')) attempt(colored);
  if (has('filter', 'from', 'to', 'gain', 'outside')) {
    plot.shade(view.from, view.filter ? (view.to < 0 ? session.modeCount : view.to) : view.from);
    attempt(() => session.filter());
  }
  if (has('features')) attempt(() => session.features());
  if (has('row')) attempt(() => session.point());
  renderer.redraw();
});

window.addEventListener('hashchange', () => {
  const asked = read(location.hash.slice(1));
  if (asked.job !== view.job || (!asked.job && asked.cloud !== view.cloud)) { reset(asked); attempt(begin); } else change(asked);
});

listenForFiles((share, name) => {
  showProgress(share === null ? null : name, 'upload', share ?? 0, `${Math.round(100 * (share ?? 0))} %`);
  find('cancel').onclick = cancelUpload;
}, ({ cloud, job }) => choose(job ? { job: job.id, cloud: cloud.id } : { cloud: cloud.id }));

onKeyNeeded((reason) => new Promise((resolve) => {
  const dialog = find('key');
  find('key-reason').textContent = reason;
  find('key-text').value = '';
  status.key = true;
  dialog.onclose = () => { status.key = false; resolve(null); };
  find('key-form').onsubmit = (event) => {
    event.preventDefault();
    resolve(find('key-text').value.trim());
    dialog.close();
  };
  dialog.showModal();
}));
for (const button of document.querySelectorAll('[data-close]')) button.addEventListener('click', () => button.closest('dialog').close());

if (scene) {
  listen(canvas, { tapped: (x, y) => session?.pick(x, y), moved: () => renderer.moved(), mode: (by) => controls.step(by) });
}
find('distances').addEventListener('click', () => change({ color: 'distance' }));
find('unpick').addEventListener('click', () => change({ row: -1 }));
find('close-message').addEventListener('click', () => tell(''));
find('theme').addEventListener('click', () => {
  const { dataset } = document.documentElement;
  const dark = dataset.theme ? dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
  dataset.theme = dark ? 'light' : 'dark';
  renderer?.recolor();
});
const copied = (text) => navigator.clipboard.writeText(text).then(() => tell('Copied.'), () => tell(text));
find('keep-link').addEventListener('click', () => copied(link()));
find('keep-curl').addEventListener('click', () => copied(curl(session.modeCount, hasKey())));
find('keep-service').addEventListener('click', () => attempt(() => savePicture(session.modeCount)));
find('keep-page').addEventListener('click', () => attempt(() => savePage(scene, document.title, session.legend)));
find('keep-picture').addEventListener('click', () => attempt(async () => {
  renderer.drawNow(Math.max(devicePixelRatio, 2));
  saveBlob(await picture(canvas, session.legend, getComputedStyle(document.body).color), 'view.png');
}));
for (const format of ['ply', 'laz']) {
  find(`save-${format}`).addEventListener('click', () => attempt(() => download(`/jobs/${view.job}/filtered?${argumentsOf(view, session.modeCount)}&format=${format}`, `filtered.${format}`)));
}

async function begin() {
  if (view.job || view.cloud) { await open(); return; }
  const some = await listLast(choose);
  find('welcome').hidden = false;
  fillForm().catch(() => {});
  status.phase = 'empty';
  status.message = some ? '' : 'nothing yet';
}

document.addEventListener('securitypolicyviolation', (event) => window.chladni.reports.push(`${event.violatedDirective} ${event.blockedURI}`));
// For the console, and for tests.
window.chladni = {
  state: status, view, fragment, reports: [],
  context: () => scene.gl,
  measure: (frames, most) => renderer.measure(frames, most),
  page: () => pageOf(scene, document.title, session.legend),
  curl: () => curl(session.modeCount, hasKey()),
  position: (row) => [0, 1, 2].map((axis) => (session.moved ?? session.positions)[3 * row + axis] + (session.live?.ofCenter ?? 1) * session.cloud.center[axis]),
};
reset(read(location.hash.slice(1)));
attempt(begin);
