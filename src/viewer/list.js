// The last clouds and jobs, by name.

import { json } from './api.js';
import { count, find, make } from './dom.js';
import { names } from './upload.js';

const SHOWN = 12;

function ago(time) {
  const seconds = (Date.now() - Date.parse(time)) / 1000;
  const units = [[86_400, 'day'], [3600, 'hour'], [60, 'minute']];
  for (const [length, name] of units) {
    const whole = Math.floor(seconds / length);
    if (whole >= 1) return `${whole} ${name}${whole > 1 ? 's' : ''} ago`;
  }
  return 'just now';
}

export const nameOf = (cloud) => cloud?.name ?? names()[cloud?.id] ?? (cloud ? `cloud …${cloud.id.slice(-6)}` : 'a cloud');

/** Shows the last jobs, and clouds without one; `choose` is called with what to open. Tells whether there are any. */
export async function listLast(choose) {
  const [{ jobs }, { clouds }] = await Promise.all([json(`/jobs?limit=${SHOWN}`), json(`/clouds?limit=${SHOWN}`)]);
  const byId = new Map(clouds.map((cloud) => [cloud.id, cloud]));
  const entry = (name, facts, parts) => make('li', {}, make('button', { type: 'button', onclick: () => choose(parts) },
    make('strong', {}, name), make('small', {}, facts)));
  const ofJobs = jobs.map((job) => {
    const { operator, bases } = job.parameters;
    const what = job.kind === 'eigen' ? `${operator}, ${bases} modes` : `${operator}, operator only`;
    const cloud = byId.get(job.cloud_id) ?? { id: job.cloud_id };
    return entry(nameOf(cloud), `${job.state === 'succeeded' ? '' : `${job.state} · `}${what} · ${ago(job.created)}`, { job: job.id });
  });
  const used = new Set(jobs.map((job) => job.cloud_id));
  const alone = clouds.filter((cloud) => !used.has(cloud.id));
  const ofClouds = alone.map((cloud) => entry(nameOf(cloud), `${count(cloud.points)} points · ${ago(cloud.created)}`, { cloud: cloud.id }));
  find('last').replaceChildren(...ofJobs, ...ofClouds);
  const some = ofJobs.length + ofClouds.length > 0;
  find('last-section').hidden = !some;
  return some;
}
