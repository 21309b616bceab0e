// Radii and normals, computed by a worker while the page goes on.

// Workers are started from this page's own files only.
const policy = window.trustedTypes?.createPolicy('chladni', {
  createScriptURL: (address) => {
    if (new URL(address).origin !== location.origin) throw new TypeError(`${address} is not a file of this page`);
    return address;
  },
});

let worker = null;
let last = 0;
const waiting = new Map();

function post(message) {
  if (!worker) {
    const address = new URL('./neighbors.js', import.meta.url).href;
    worker = new Worker(policy ? policy.createScriptURL(address) : address);
    worker.onmessage = ({ data }) => {
      waiting.get(data.id)?.(data);
      waiting.delete(data.id);
    };
  }
  last += 1;
  const id = last;
  return new Promise((resolve) => {
    waiting.set(id, resolve);
    worker.postMessage({ ...message, id });
  });
}

/** `{normals, radii}` of new points; what was asked for before is given up. */
export function surfaceOf(positions, faces) {
  worker?.terminate();
  worker = null;
  waiting.clear();
  return post({ task: 'surface', positions, faces });
}

/** Normals after the same points have moved. */
export async function normalsAfterMove(positions) {
  return (await post({ task: 'move', positions })).normals;
}
