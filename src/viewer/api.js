// Talking to the service: the key, problems, uploads with their progress, events.

const KEY = 'chladni-key';
let askForKey = async () => null;
let asking = null;

/** What the service says went wrong. */
export class Problem extends Error {
  constructor(status, document) {
    super(document?.detail || document?.title || `the service answered with status ${status}`);
    this.status = status;
    this.kind = document?.type ?? '';
  }
}

export function onKeyNeeded(ask) { askForKey = ask; }
export function hasKey() { return Boolean(sessionStorage.getItem(KEY)); }

function headers(more) {
  const key = sessionStorage.getItem(KEY);
  return key ? { ...more, Authorization: `Bearer ${key}` } : { ...more };
}

/** Asks once, however many requests wait for it. */
async function newKey(reason) {
  asking ??= askForKey(reason).finally(() => { asking = null; });
  const key = await asking;
  if (!key) return false;
  sessionStorage.setItem(KEY, key);
  return true;
}

async function problemOf(response) {
  const document = await response.json().catch(() => null);
  return new Problem(response.status, document);
}

/** A successful answer; asks for a key where one is wanted. */
export async function request(path, options = {}) {
  for (;;) {
    let response;
    const sent = sessionStorage.getItem(KEY);
    try {
      response = await fetch(path, { ...options, headers: headers(options.headers), cache: 'no-cache' });
    } catch (error) {
      if (error.name === 'AbortError') throw error;
      throw new Error('the service does not answer; is it still running?');
    }
    if (response.ok) return response;
    const problem = await problemOf(response);
    const other = sessionStorage.getItem(KEY) !== sent;
    if (response.status === 401 && (other || await newKey(sent ? problem.message : ''))) continue;
    throw problem;
  }
}

export const json = async (path, options) => (await request(path, options)).json();
export const buffer = async (path, options) => (await request(path, options)).arrayBuffer();

/** Uploads a file; `progress` is called with the share that is sent. XMLHttpRequest, for fetch does not tell. */
export async function upload(name, file, query, progress, signal) {
  await request('/jobs?limit=1');
  return new Promise((resolve, reject) => {
    const call = new XMLHttpRequest();
    call.open('PUT', `/clouds/${encodeURIComponent(name)}?${query}`);
    for (const [header, value] of Object.entries(headers())) call.setRequestHeader(header, value);
    call.responseType = 'json';
    call.upload.onprogress = (event) => progress(event.lengthComputable ? event.loaded / event.total : 0);
    call.onload = () => {
      if (call.status < 300) resolve(call.response);
      else reject(new Problem(call.status, call.response));
    };
    call.onerror = () => reject(new Error('the connection broke during the upload'));
    call.onabort = () => reject(new DOMException('canceled', 'AbortError'));
    signal?.addEventListener('abort', () => call.abort());
    // As bytes without a type: browsers guess one from the name, for .obj a drawing program of long ago.
    call.send(file.slice());
  });
}

/** Follows a job; calls `seen` with it whenever it has changed, until it has ended. EventSource cannot send a key. */
export async function follow(id, seen, signal) {
  for (;;) {
    const response = await request(`/jobs/${id}/events`, { signal, headers: { Accept: 'text/event-stream' } });
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    let text = '';
    let last = null;
    for (;;) {
      const { done, value } = await reader.read().catch((error) => {
        if (signal?.aborted) throw error;
        return { done: true };
      });
      if (done) break;
      const events = (text + value).split('\n\n');
      text = events.pop();
      for (const event of events) {
        const data = event.split('\n').filter((line) => line.startsWith('data:')).map((line) => line.slice(5));
        if (data.length) seen(last = JSON.parse(data.join('\n')));
      }
    }
    if (last && ended(last)) return last;
    // The stream broke off, or the job was deleted: asking for it tells which.
    const job = await json(`/jobs/${id}`, { signal });
    seen(job);
    if (ended(job)) return job;
  }
}

export const ended = (job) => ['succeeded', 'failed', 'canceled'].includes(job.state);

/** Saves what the service sends at a path. An address in a link could not carry the key. */
export async function download(path, name) {
  saveBlob(await (await request(path)).blob(), name);
}

export function saveBlob(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
