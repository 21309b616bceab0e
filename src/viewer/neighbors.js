// A worker: neighbors of every point by a k-d tree, from which follow the radius of its disc and the normal.

const NEIGHBORS = 10;
// Of the seventh nearest, and at most twice the neighbors' median, as in the service's pictures (picture/spacing.rs). A
// little larger than there, for these discs do not face the viewer.
const RADIUS_OF = 7;
const RADIUS = 0.95;
const RADIUS_MOST = 2;
// Times that normals are smoothed: scans are rough.
const SMOOTHED = 2;
const LEAF = 12;
const STACK = 128;

let kept = null;

self.onmessage = ({ data }) => {
  const { task, positions, faces } = data;
  if (task === 'surface') {
    kept = faces ? { faces } : { near: nearest(positions) };
    const radii = faces ? radiiOfEdges(positions, faces) : radiiOf(positions, kept.near);
    answer(data.id, normalsOf(positions), radii);
  } else if (kept) {
    answer(data.id, normalsOf(positions), null);
  }
};

function answer(id, normals, radii) {
  self.postMessage({ id, normals, radii }, radii ? [normals.buffer, radii.buffer] : [normals.buffer]);
}

const normalsOf = (positions) => packed(kept.faces ? ofFaces(positions, kept.faces) : ofNeighbors(positions, kept.near));

/** Rows in the order of a balanced tree: a node is the middle of its range, cut along the widest axis of the range. */
function tree(p, rows) {
  const axes = new Uint8Array(rows.length);
  const work = [[0, rows.length]];
  while (work.length) {
    const [from, to] = work.pop();
    if (to - from <= LEAF) continue;
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (let i = from; i < to; i += 1) {
      for (let a = 0; a < 3; a += 1) {
        const x = p[3 * rows[i] + a];
        if (x < low[a]) low[a] = x;
        if (x > high[a]) high[a] = x;
      }
    }
    const wide = low.map((x, a) => high[a] - x);
    const axis = wide.indexOf(Math.max(...wide));
    const middle = (from + to) >> 1;
    split(p, rows, axis, from, to - 1, middle);
    axes[middle] = axis;
    work.push([from, middle], [middle + 1, to]);
  }
  return axes;
}

function split(p, rows, axis, low, high, place) {
  while (low < high) {
    const pivot = p[3 * rows[(low + high) >> 1] + axis];
    let [i, j] = [low, high];
    while (i <= j) {
      while (p[3 * rows[i] + axis] < pivot) i += 1;
      while (p[3 * rows[j] + axis] > pivot) j -= 1;
      if (i <= j) {
        const row = rows[i];
        rows[i] = rows[j];
        rows[j] = row;
        i += 1;
        j -= 1;
      }
    }
    if (place <= j) high = j;
    else if (place >= i) low = i;
    else break;
  }
}

/** NEIGHBORS rows per row, nearest first; −1 where there are none. */
function nearest(p) {
  const count = p.length / 3;
  const rows = Uint32Array.from({ length: count }, (_, i) => i).filter((i) => Number.isFinite(p[3 * i] + p[3 * i + 1] + p[3 * i + 2]));
  const axes = tree(p, rows);
  const near = new Int32Array(NEIGHBORS * count).fill(-1);
  const best = new Float64Array(NEIGHBORS);
  const [froms, tos, gaps] = [new Int32Array(STACK), new Int32Array(STACK), new Float64Array(STACK)];
  for (const row of rows) {
    const [x, y, z, at] = [p[3 * row], p[3 * row + 1], p[3 * row + 2], NEIGHBORS * row];
    best.fill(Infinity);
    let top = 1;
    [froms[0], tos[0], gaps[0]] = [0, rows.length, 0];
    const look = (other) => {
      if (other === row) return;
      const d = (p[3 * other] - x) ** 2 + (p[3 * other + 1] - y) ** 2 + (p[3 * other + 2] - z) ** 2;
      if (d >= best[NEIGHBORS - 1] || d === 0) return;
      let i = NEIGHBORS - 1;
      for (; i > 0 && best[i - 1] > d; i -= 1) { best[i] = best[i - 1]; near[at + i] = near[at + i - 1]; }
      best[i] = d;
      near[at + i] = other;
    };
    while (top) {
      top -= 1;
      let [from, to] = [froms[top], tos[top]];
      if (gaps[top] >= best[NEIGHBORS - 1]) continue;
      while (to - from > LEAF) {
        const middle = (from + to) >> 1;
        const node = rows[middle];
        const gap = (axes[middle] === 0 ? x : axes[middle] === 1 ? y : z) - p[3 * node + axes[middle]];
        look(node);
        gaps[top] = gap * gap;
        if (gap < 0) { [froms[top], tos[top]] = [middle + 1, to]; to = middle; } else { [froms[top], tos[top]] = [from, middle]; from = middle + 1; }
        top += 1;
      }
      for (let i = from; i < to; i += 1) look(rows[i]);
    }
  }
  return near;
}

function radiiOf(p, near) {
  const own = new Float32Array(p.length / 3);
  for (let row = 0; row < own.length; row += 1) {
    for (let i = RADIUS_OF - 1; i >= 0; i -= 1) {
      const other = near[NEIGHBORS * row + i];
      if (other < 0) continue;
      own[row] = RADIUS * Math.hypot(p[3 * other] - p[3 * row], p[3 * other + 1] - p[3 * row + 1], p[3 * other + 2] - p[3 * row + 2]);
      break;
    }
  }
  const around = new Float32Array(RADIUS_OF);
  return own.map((radius, row) => {
    let count = 0;
    for (let i = 0; i < RADIUS_OF; i += 1) {
      const other = near[NEIGHBORS * row + i];
      if (other >= 0) { around[count] = own[other]; count += 1; }
    }
    if (!count) return radius;
    return Math.min(radius, RADIUS_MOST * around.subarray(0, count).sort()[count >> 1]);
  });
}

function radiiOfEdges(p, faces) {
  const radii = new Float32Array(p.length / 3);
  for (let i = 0; i < faces.length; i += 3) {
    for (let side = 0; side < 3; side += 1) {
      const [a, b] = [faces[i + side], faces[i + (side + 1) % 3]];
      const d = 0.6 * Math.hypot(p[3 * a] - p[3 * b], p[3 * a + 1] - p[3 * b + 1], p[3 * a + 2] - p[3 * b + 2]);
      radii[a] = Math.max(radii[a], d);
      radii[b] = Math.max(radii[b], d);
    }
  }
  return radii;
}

/** Sums of the faces' normals, longer the larger the face. */
function ofFaces(p, faces) {
  const sums = new Float32Array(p.length);
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = [3 * faces[i], 3 * faces[i + 1], 3 * faces[i + 2]];
    const [ux, uy, uz] = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
    const [vx, vy, vz] = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const corner of [a, b, c]) for (let axis = 0; axis < 3; axis += 1) sums[corner + axis] += normal[axis];
  }
  return sums;
}

/** Directions in which neighborhoods are thinnest, smoothed over neighbors. */
function ofNeighbors(p, near) {
  let normals = new Float32Array(p.length);
  for (let row = 0; row < p.length / 3; row += 1) thinnest(p, near, row, normals);
  for (let pass = 0; pass < SMOOTHED; pass += 1) normals = smoothed(normals, near);
  return normals;
}

/** Means with the nearest neighbors, turned to the same side, and again of length 1. */
function smoothed(normals, near) {
  const sums = normals.slice();
  for (let row = 0; row < normals.length / 3; row += 1) {
    const at = 3 * row;
    const [x, y, z] = [normals[at], normals[at + 1], normals[at + 2]];
    for (let i = 0; i < RADIUS_OF; i += 1) {
      const other = 3 * near[NEIGHBORS * row + i];
      if (other < 0) break;
      const side = normals[other] * x + normals[other + 1] * y + normals[other + 2] * z;
      for (let axis = 0; axis < 3; axis += 1) sums[at + axis] += side * normals[other + axis];
    }
    const length = Math.sqrt(sums[at] ** 2 + sums[at + 1] ** 2 + sums[at + 2] ** 2) || 1;
    for (let axis = 0; axis < 3; axis += 1) sums[at + axis] /= length;
  }
  return sums;
}

/** The eigenvector of the covariance with the least eigenvalue, which has a closed form in three dimensions. */
function thinnest(p, near, row, normals) {
  let [count, mx, my, mz] = [0, 0, 0, 0];
  const at = NEIGHBORS * row;
  for (let i = 0; i < NEIGHBORS && near[at + i] >= 0; i += 1) {
    const other = 3 * near[at + i];
    mx += p[other]; my += p[other + 1]; mz += p[other + 2];
    count += 1;
  }
  if (count < 3) return;
  mx /= count; my /= count; mz /= count;
  let [xx, xy, xz, yy, yz, zz] = [0, 0, 0, 0, 0, 0];
  for (let i = 0; i < count; i += 1) {
    const other = 3 * near[at + i];
    const [x, y, z] = [p[other] - mx, p[other + 1] - my, p[other + 2] - mz];
    xx += x * x; xy += x * y; xz += x * z; yy += y * y; yz += y * z; zz += z * z;
  }
  const mean = (xx + yy + zz) / 3;
  const off = xy * xy + xz * xz + yz * yz;
  const spread = Math.sqrt(((xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2 + 2 * off) / 6) || 1e-300;
  const [a, b, c] = [(xx - mean) / spread, (yy - mean) / spread, (zz - mean) / spread];
  const [d, e, f] = [xy / spread, xz / spread, yz / spread];
  const half = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / 2;
  const least = 2 * Math.cos(Math.acos(Math.min(1, Math.max(-1, half))) / 3 + 2 * Math.PI / 3);
  const rows = [[a - least, d, e], [d, b - least, f], [e, f, c - least]];
  let most = 0;
  for (const [i, j] of [[0, 1], [0, 2], [1, 2]]) {
    const [u, v] = [rows[i], rows[j]];
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...n);
    if (length > most) {
      most = length;
      for (let axis = 0; axis < 3; axis += 1) normals[3 * row + axis] = n[axis] / length;
    }
  }
}

/** Unit vectors in four bytes each; nothing stays nothing. */
function packed(normals) {
  const bytes = new Int8Array(normals.length / 3 * 4);
  for (let row = 0; row < normals.length / 3; row += 1) {
    const length = Math.hypot(normals[3 * row], normals[3 * row + 1], normals[3 * row + 2]);
    if (length > 0) for (let axis = 0; axis < 3; axis += 1) bytes[4 * row + axis] = Math.round(127 * normals[3 * row + axis] / length);
  }
  return bytes;
}
