// A job on its way: phase, share, time to its end, canceling it.

import { follow, request } from './api.js';
import { find, say, tell } from './dom.js';
import { status } from './state.js';

let following = null;

/** Shows the share of something that goes on; null hides it. */
export function showProgress(name, phase, share, eta) {
  find('progress').hidden = name === null;
  if (name === null) return;
  find('progress-name').textContent = name;
  find('progress-phase').textContent = phase;
  find('progress-bar').value = share;
  find('progress-eta').textContent = eta;
}

function etaOf(job) {
  if (job.state === 'queued') return job.queue_position ? `${job.queue_position} jobs before it` : 'about to begin';
  if (job.eta_seconds === null) return `${Math.round(100 * job.progress)} %`;
  return `${Math.round(100 * job.progress)} %, about ${Math.max(1, Math.round(job.eta_seconds))} s to go`;
}

/** The job once it has ended, shown while it goes on; null when another one took its place. */
export async function watch(job, name) {
  following?.abort();
  const own = new AbortController();
  following = own;
  find('cancel').onclick = () => request(`/jobs/${job.id}/cancel`, { method: 'POST' }).catch((error) => tell(error.message, true));
  let phase = '';
  try {
    return await follow(job.id, (now) => {
      if (own.signal.aborted) return;
      Object.assign(status, { phase: now.state, message: now.phase ?? '' });
      status.job = { id: now.id, state: now.state, progress: now.progress };
      showProgress(name, now.phase ?? now.state, now.progress, etaOf(now));
      if (now.phase !== phase) say(`${now.phase ?? now.state}, ${Math.round(100 * now.progress)} percent`);
      phase = now.phase;
    }, own.signal);
  } catch (error) {
    if (error.name === 'AbortError') return null;
    throw error;
  } finally {
    if (following === own) showProgress(null);
  }
}

export function unwatch() {
  following?.abort();
  following = null;
  showProgress(null);
}
