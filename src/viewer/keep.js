// What can be kept of a view: a picture, the service's own picture, a link, a page of its own, commands.

import { download, saveBlob } from './api.js';
import { bytesOf } from './colors.js';
import { argumentsOf } from './filter.js';
import { number } from './dom.js';
import { PALETTE } from './palette.js';
import { SCALES } from './coloring.js';
import { fragment, view } from './state.js';

/** The canvas with its legend. The scene must have been drawn in the same task. */
export function picture(canvas, legend, ink) {
  const sheet = document.createElement('canvas');
  [sheet.width, sheet.height] = [canvas.width, canvas.height];
  const pen = sheet.getContext('2d');
  pen.drawImage(canvas, 0, 0);
  if (legend && PALETTE[legend.kind]) {
    const unit = sheet.width / canvas.clientWidth;
    pen.setTransform(unit, 0, 0, unit, 0, 0);
    const [x, y] = [20, sheet.height / unit - 44];
    const bytes = bytesOf(PALETTE[legend.kind]);
    for (let i = 0; i < bytes.length / 3; i += 1) {
      pen.fillStyle = `rgb(${bytes[3 * i]},${bytes[3 * i + 1]},${bytes[3 * i + 2]})`;
      pen.fillRect(x + i * 220 / 256, y, 1, 8);
    }
    pen.fillStyle = ink;
    pen.font = '13px system-ui, sans-serif';
    pen.fillText(`${legend.title}${legend.unit ? ` (${legend.unit})` : ''}`, x, y - 8);
    pen.font = '11px system-ui, sans-serif';
    const middle = legend.kind === 'diverging' ? '0' : number((legend.low + legend.high) / 2, 3);
    [['left', 0, number(legend.low, 3)], ['center', 110, middle], ['right', 220, number(legend.high, 3)]]
      .forEach(([align, at, text]) => { pen.textAlign = align; pen.fillText(text, x + at, y + 22); });
  }
  return new Promise((resolve) => { sheet.toBlob(resolve, 'image/png'); });
}

const looked = () => ({ legend: true, azimuth: rounded(view.azimuth), elevation: rounded(view.elevation), up: view.up });
const rounded = (value) => +value.toFixed(2);

/** The address of the service's own picture of what is seen. */
export function imagePath(modes) {
  const query = new URLSearchParams(looked());
  if (view.filter && modes) return `/jobs/${view.job}/filtered?${argumentsOf(view, modes)}&format=png&${query}`;
  if (view.features && view.job) return `/jobs/${view.job}/features?format=png&limit=${view.features}&${query}`;
  if (view.job && modes && view.color === 'basis') return `/jobs/${view.job}/bases/${view.basis}/image.png?${query}`;
  return `/clouds/${view.cloud}/points?format=png&${query}`;
}

/** The address of the numbers of what is seen, and a name for the file. */
export function dataPath(modes) {
  if (!modes) return [`/clouds/${view.cloud}/points?format=ply`, 'points.ply'];
  if (view.filter) return [`/jobs/${view.job}/filtered?${argumentsOf(view, modes)}&format=ply`, 'filtered.ply'];
  const paths = {
    basis: [`/jobs/${view.job}/bases?format=npy&first=${view.basis}&count=1`, `mode-${view.basis}.npy`],
    hks: [`/jobs/${view.job}/signatures?kind=hks&count=${SCALES}&format=npy`, 'hks.npy'],
    wks: [`/jobs/${view.job}/signatures?kind=wks&count=${SCALES}&format=npy`, 'wks.npy'],
    distance: [`/jobs/${view.job}/distances?from=${Math.max(view.row, 0)}&format=npy`, 'distances.npy'],
  };
  return paths[view.color] ?? [`/clouds/${view.cloud}/points?format=ply`, 'points.ply'];
}

/** What a shell would have to run for the same numbers and the same picture. */
export function curl(modes, withKey) {
  const key = withKey ? ' -H "Authorization: Bearer $CHLADNI_KEY"' : '';
  const [path, file] = dataPath(modes);
  return [[path, file], [imagePath(modes), 'view.png']].map(([address, name]) => `curl -f${key} -o ${name} '${location.origin}${address}'`).join('\n');
}

export const link = () => `${location.origin}${location.pathname}#${fragment()}`;

export const savePicture = (modes) => download(imagePath(modes), 'view.png');

const inText = (data) => {
  const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
  let text = '';
  for (let i = 0; i < bytes.length; i += 0x8000) text += String.fromCharCode(...bytes.subarray(i, i + 0x8000));
  return btoa(text);
};

/** One file that shows the view without a service: what draws it, and the numbers. Opens from disk. */
export async function pageOf(scene, name, legend) {
  const script = await (await fetch(new URL('page.js', import.meta.url))).text();
  const arrays = Object.fromEntries(Object.entries(scene.kept).filter(([kind]) => kind !== 'order')
    .map(([kind, data]) => [kind, [data.constructor.name, inText(data)]]));
  const data = { name, legend, view: { ...view }, paint: scene.paint, ball: scene.ball, radius: scene.radius, background: scene.background, arrays };
  const escaped = JSON.stringify(data).replaceAll('<', '\\u003c');
  return ['<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">',
    '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; script-src \'unsafe-inline\'; style-src \'unsafe-inline\'">',
    '<title>chladni</title><style>html,body{margin:0;height:100%;overflow:hidden;font:14px system-ui,sans-serif}canvas{width:100%;height:100%;display:block;touch-action:none}',
    'p{position:fixed;left:16px;bottom:8px;margin:0;color:#777}</style><canvas id="canvas" tabindex="0" role="img"></canvas><p id="caption"></p>',
    `<script type="application/json" id="data">${escaped}</script><script>${script.replaceAll('</script', '<\\/script')}</script></html>`].join('\n');
}

export async function savePage(scene, name, legend) {
  saveBlob(new Blob([await pageOf(scene, name, legend)], { type: 'text/html' }), 'view.html');
}
