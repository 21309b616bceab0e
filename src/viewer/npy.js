// Numbers as the service sends them: NumPy arrays, and the faces and fields of binary PLY.

const TYPES = {
  char: [1, 'getInt8'], uchar: [1, 'getUint8'], short: [2, 'getInt16'], ushort: [2, 'getUint16'],
  int: [4, 'getInt32'], uint: [4, 'getUint32'], float: [4, 'getFloat32'], double: [8, 'getFloat64'],
  int8: [1, 'getInt8'], uint8: [1, 'getUint8'], int16: [2, 'getInt16'], uint16: [2, 'getUint16'],
  int32: [4, 'getInt32'], uint32: [4, 'getUint32'], float32: [4, 'getFloat32'], float64: [8, 'getFloat64'],
};

/** What the head of an npy file says: where the numbers begin, bytes of each, their shape and order. */
export function readNpyHead(buffer) {
  const bytes = new Uint8Array(buffer);
  if (bytes[0] !== 0x93 || bytes[6] !== 1) throw new Error('the answer is not a NumPy array of version 1');
  const begin = 10 + bytes[8] + 256 * bytes[9];
  const head = new TextDecoder().decode(bytes.subarray(10, begin));
  const size = Number(/'descr': '<f([48])'/.exec(head)?.[1]);
  const shape = /'shape': \(([^)]*)\)/.exec(head)?.[1].split(',').filter((text) => text.trim()).map(Number);
  if (!size || !shape) throw new Error(`the array has a head that is not understood: ${head.trim()}`);
  return { begin, size, shape, byColumns: /'fortran_order': True/.test(head) && shape.length === 2 };
}

/** `{shape, data}` of an npy file of single or double precision. */
export function readNpy(buffer) {
  const { begin, size, shape, byColumns } = readNpyHead(buffer);
  const data = numbers(buffer, begin, size);
  return { shape, data: byColumns ? transposed(data, shape) : data };
}

export const numbers = (buffer, begin, size) => (size === 4 ? new Float32Array(buffer, begin) : new Float64Array(buffer, begin));

function transposed(data, [rows, columns]) {
  const turned = new data.constructor(data.length);
  for (let column = 0; column < columns; column += 1) {
    for (let row = 0; row < rows; row += 1) turned[row * columns + column] = data[column * rows + row];
  }
  return turned;
}

/** An npy file of one axis, single precision. */
export function writeNpy(values) {
  const head = `{'descr': '<f4', 'fortran_order': False, 'shape': (${values.length},), }`.padEnd(117) + '\n';
  const file = new Uint8Array(10 + head.length + 4 * values.length);
  file.set([0x93, 78, 85, 77, 80, 89, 1, 0, head.length, 0]);
  file.set(new TextEncoder().encode(head), 10);
  file.set(new Uint8Array(Float32Array.from(values).buffer), 10 + head.length);
  return file;
}

/** Layout of a binary little-endian PLY: vertices, their properties with offsets, where faces begin. */
export function readPlyHead(buffer) {
  const start = new TextDecoder('latin1').decode(buffer.slice(0, Math.min(buffer.byteLength, 1 << 18)));
  const end = start.indexOf('end_header\n');
  if (!start.startsWith('ply') || end < 0) throw new Error('the answer is not PLY');
  const text = new TextDecoder().decode(buffer.slice(0, end));
  const layout = { begin: end + 11, vertices: 0, faces: 0, stride: 0, properties: [], face: [] };
  let element = '';
  for (const line of text.split('\n')) {
    const words = line.split(' ');
    if (words[0] === 'element') {
      element = words[1];
      if (element === 'vertex') layout.vertices = Number(words[2]);
      if (element === 'face') layout.faces = Number(words[2]);
    } else if (words[0] === 'property' && element === 'vertex') {
      const [size, read] = TYPES[words[1]];
      layout.properties.push({ name: words.slice(2).join(' '), offset: layout.stride, read });
      layout.stride += size;
    } else if (words[0] === 'property' && words[1] === 'list') {
      layout.face = [TYPES[words[2]], TYPES[words[3]]];
    }
  }
  layout.facesAt = layout.begin + layout.vertices * layout.stride;
  return layout;
}

/** One property of every vertex. */
export function readPlyField(buffer, layout, property) {
  const data = new DataView(buffer, layout.begin);
  const values = new Float32Array(layout.vertices);
  for (let row = 0; row < layout.vertices; row += 1) values[row] = data[property.read](row * layout.stride + property.offset, true);
  return values;
}

/** Triangles, polygons cut into fans. */
export function readPlyFaces(bytes, layout) {
  const data = new DataView(bytes);
  const [[countSize, readCount], [indexSize, readIndex]] = layout.face;
  const corners = [];
  for (let face = 0, at = 0; face < layout.faces; face += 1) {
    const count = data[readCount](at, true);
    at += countSize;
    const corner = (i) => data[readIndex](at + i * indexSize, true);
    for (let i = 2; i < count; i += 1) corners.push(corner(0), corner(i - 1), corner(i));
    at += count * indexSize;
  }
  return Uint32Array.from(corners);
}
