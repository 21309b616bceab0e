// Draws points as lit discs, or triangles, colored by one number each, and marks on top; tells which point is at a pixel.

import { matrices } from './camera.js';
import { bytesOf, tableOf } from './colors.js';
import { PALETTE } from './palette.js';
import { FACE_FRAGMENT, FACE_VERTEX, MARK_FRAGMENT, MARK_VERTEX, PICK_FRAGMENT, POINT_FRAGMENT, POINT_VERTEX } from './shaders.js';

// Attributes by their place in the shaders: numbers per point and how they are kept.
const ATTRIBUTES = { positions: [0, 3], values: [1, 1], radii: [2, 1], normals: [3, 4], own: [4, 3] };
const PAINTS = { plain: 0, diverging: 1, sequential: 1, own: 2 };
const LABEL_COLUMNS = 16;
const LABEL_PIXELS = 48;
const MARK_SIZE = 22;
// Share of a full turn of the golden ratio: multiples of it are spread evenly over the rows.
const SPREAD = 0.6180339887498949;

export class Scene {
  constructor(canvas) {
    this.canvas = canvas;
    this.gl = canvas.getContext('webgl2', { antialias: false, alpha: false, powerPreference: 'high-performance' });
    if (!this.gl) throw new Error('this browser offers no WebGL 2');
    this.kept = {};
    this.paint = { kind: 'plain', low: 0, high: 1 };
    this.background = [1, 1, 1];
    this.radius = 1;
    this.ball = { center: [0, 0, 0], radius: 1 };
    this.count = 0;
    this.lost = false;
    this.onRestored = () => {};
    this.build();
    canvas.addEventListener('webglcontextlost', (event) => { event.preventDefault(); this.lost = true; });
    canvas.addEventListener('webglcontextrestored', () => this.restore());
  }

  /** Everything that lives on the graphics card. */
  build() {
    const { gl } = this;
    this.programs = {
      point: program(gl, POINT_VERTEX, POINT_FRAGMENT),
      face: program(gl, FACE_VERTEX, FACE_FRAGMENT),
      pick: program(gl, POINT_VERTEX, PICK_FRAGMENT),
      mark: program(gl, MARK_VERTEX, MARK_FRAGMENT),
    };
    this.buffers = {};
    this.cloud = gl.createVertexArray();
    this.marked = gl.createVertexArray();
    this.tables = { diverging: texture(gl, tableOf('diverging'), 256, 1), sequential: texture(gl, tableOf('sequential'), 256, 1) };
    this.labels = labels(gl);
    this.target = pickTarget(gl);
    this.frame = { handle: gl.createFramebuffer(), width: 0, height: 0 };
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
  }

  restore() {
    this.lost = false;
    this.build();
    for (const [name, data] of Object.entries(this.kept)) this.put(name, data);
    this.onRestored();
  }

  /** A new cloud of recentered points, within a ball; `radius` is that of a disc until neighbors are known. */
  setPoints(positions, ball, radius) {
    for (const name of Object.keys(this.kept)) this.put(name, null);
    this.kept = {};
    Object.assign(this, { ball, radius, count: positions.length / 3, order: null });
    this.paint = { kind: 'plain', low: 0, high: 1 };
    this.set('positions', positions);
  }

  /** `positions`, `values`, `radii`, `normals`, `own` (bytes of color), `faces`, `marks` (x, y, z, label); null removes. */
  set(name, data) {
    if (data) this.kept[name] = data; else delete this.kept[name];
    if (!this.lost) this.put(name, data);
  }

  put(name, data) {
    const { gl } = this;
    gl.bindVertexArray(name === 'marks' ? this.marked : this.cloud);
    if (name === 'faces' || name === 'order') {
      this.buffers[name] ??= gl.createBuffer();
      if (data) fill(gl, gl.ELEMENT_ARRAY_BUFFER, this.buffers[name], data);
      return;
    }
    if (name === 'marks') {
      this.buffers.marks ??= gl.createBuffer();
      if (!data) return;
      fill(gl, gl.ARRAY_BUFFER, this.buffers.marks, data);
      for (const [place, size, offset] of [[0, 3, 0], [1, 1, 12]]) {
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, size, gl.FLOAT, false, 16, offset);
      }
      return;
    }
    const [place, size] = ATTRIBUTES[name];
    if (!data) { gl.disableVertexAttribArray(place); return; }
    this.buffers[name] ??= gl.createBuffer();
    fill(gl, gl.ARRAY_BUFFER, this.buffers[name], data);
    const kind = { normals: gl.BYTE, own: gl.UNSIGNED_BYTE }[name] ?? gl.FLOAT;
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, kind, kind !== gl.FLOAT, 0, 0);
  }

  /** Draws everything; of more than `most` points some that are spread evenly. Tells how many. */
  draw(view, most = Infinity) {
    const { gl, canvas } = this;
    if (this.lost) return 0;
    const camera = matrices(view, this.ball, canvas.width, canvas.height);
    this.fitFrame();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame.handle);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...this.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const drawn = this.kept.faces ? this.count : Math.min(this.count, most);
    if (drawn) this.drawCloud(camera, this.kept.faces ? 'face' : 'point', drawn);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.frame.handle);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, canvas.width, canvas.height, 0, 0, canvas.width, canvas.height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    if (drawn && this.kept.marks) this.drawMarks(camera);
    return drawn;
  }

  /** The cloud is drawn beside the canvas, so that marks can ask what lies before them. */
  fitFrame() {
    const { gl, frame, canvas: { width, height } } = this;
    if (frame.width === width && frame.height === height) return;
    Object.assign(frame, { width, height });
    gl.deleteTexture(frame.color);
    gl.deleteTexture(frame.depth);
    frame.color = texture(gl, null, width, height);
    frame.depth = texture(gl, null, width, height, [gl.DEPTH_COMPONENT24, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame.handle);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, frame.color, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, frame.depth, 0);
  }

  drawCloud(camera, name, drawn) {
    const { gl, kept } = this;
    const set = this.use(name, camera);
    gl.bindVertexArray(this.cloud);
    gl.vertexAttrib1f(2, this.radius);
    gl.vertexAttrib4f(3, 0, 0, 0, 0);
    gl.uniform1f(set.u_size, Math.sqrt(this.count / drawn));
    if (name === 'face') {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.faces);
      gl.drawElements(gl.TRIANGLES, kept.faces.length, gl.UNSIGNED_INT, 0);
    } else if (drawn < this.count) {
      if (!this.order) this.put('order', this.order = evenly(this.count));
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.order);
      gl.drawElements(gl.POINTS, drawn, gl.UNSIGNED_INT, 0);
    } else {
      gl.drawArrays(gl.POINTS, 0, this.count);
    }
  }

  drawMarks(camera) {
    const { gl } = this;
    const set = this.use('mark', camera);
    this.put('marks', fartherFirst(this.kept.marks, camera.look));
    [this.labels, this.frame.depth].forEach((one, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, one);
    });
    gl.uniform1i(set.u_labels, 0);
    gl.uniform1i(set.u_depth, 1);
    gl.uniform1f(set.u_columns, LABEL_COLUMNS);
    gl.uniform1f(set.u_size, MARK_SIZE * (this.ratio ?? 1));
    gl.uniform3fv(set.u_color, color('mark'));
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.POINTS, 0, this.kept.marks.length / 4);
    gl.enable(gl.DEPTH_TEST);
  }

  use(name, camera) {
    const { gl, paint } = this;
    const { handle, set } = this.programs[name];
    gl.useProgram(handle);
    gl.uniformMatrix4fv(set.u_look, false, camera.look);
    gl.uniformMatrix4fv(set.u_project, false, camera.project);
    gl.uniform1f(set.u_pixels, camera.pixels);
    if (name === 'mark') return set;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.tables[paint.kind] ?? this.tables.diverging);
    gl.uniform1i(set.u_table, 0);
    gl.uniform1i(set.u_paint, PAINTS[paint.kind]);
    gl.uniform2f(set.u_range, paint.low, paint.high);
    gl.uniform3fv(set.u_plain, color('plain'));
    gl.uniform3fv(set.u_absent, color('absent'));
    return set;
  }

  /** The row and the color without light at a place of the canvas in pixels from the top left; null beside the cloud. */
  pick(view, x, y) {
    const { gl, canvas } = this;
    if (this.lost || !this.count) return null;
    const camera = matrices(view, this.ball, canvas.width, canvas.height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(-Math.floor(x), Math.floor(y) - canvas.height + 1, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.drawCloud(camera, 'pick', this.count);
    const read = (attachment) => {
      const bytes = new Uint8Array(4);
      gl.readBuffer(attachment);
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
      return bytes;
    };
    const id = read(gl.COLOR_ATTACHMENT0);
    const row = (id[0] | id[1] << 8 | id[2] << 16 | id[3] << 24) - 1;
    return row < 0 ? null : { row, color: [...read(gl.COLOR_ATTACHMENT1)].slice(0, 3) };
  }
}

const color = (name) => [...bytesOf(PALETTE[name])].map((byte) => byte / 255);

function fill(gl, kind, buffer, data) {
  gl.bindBuffer(kind, buffer);
  gl.bufferData(kind, data, gl.DYNAMIC_DRAW);
}

function evenly(count) {
  let step = Math.max(1, Math.round(count * SPREAD));
  const common = (a, b) => (b ? common(b, a % b) : a);
  while (common(step, count) > 1) step += 1;
  const order = new Uint32Array(count);
  for (let i = 1; i < count; i += 1) order[i] = (order[i - 1] + step) % count;
  return order;
}

function program(gl, vertex, fragment) {
  const handle = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(handle, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
  }
  gl.linkProgram(handle);
  if (!gl.getProgramParameter(handle, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(handle));
  const set = {};
  for (let i = 0; i < (gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS) ?? 0); i += 1) {
    const { name } = gl.getActiveUniform(handle, i);
    set[name] = gl.getUniformLocation(handle, name);
  }
  return { handle, set };
}

/** Marks in the order in which they are drawn over each other. */
function fartherFirst(marks, look) {
  const near = (i) => look[2] * marks[i] + look[6] * marks[i + 1] + look[10] * marks[i + 2];
  const places = Array.from({ length: marks.length / 4 }, (_, i) => 4 * i).sort((a, b) => near(a) - near(b));
  return Float32Array.from(places.flatMap((i) => [...marks.subarray(i, i + 4)]));
}

function texture(gl, bytes, width, height, [inside, format, kind] = [gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE]) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, format, kind, bytes);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return made;
}

/** The numbers of marks, 1 to 255, white on nothing. */
function labels(gl) {
  const sheet = document.createElement('canvas');
  sheet.width = sheet.height = LABEL_COLUMNS * LABEL_PIXELS;
  const pen = sheet.getContext('2d');
  pen.textAlign = 'center';
  pen.textBaseline = 'middle';
  pen.fillStyle = '#fff';
  for (let i = 1; i < LABEL_COLUMNS ** 2; i += 1) {
    pen.font = `600 ${LABEL_PIXELS * (i < 10 ? 0.6 : i < 100 ? 0.5 : 0.38)}px system-ui, sans-serif`;
    pen.fillText(i, (i % LABEL_COLUMNS + 0.5) * LABEL_PIXELS, (Math.floor(i / LABEL_COLUMNS) + 0.53) * LABEL_PIXELS);
  }
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, sheet);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  return made;
}

/** A frame of one pixel: the row, and the color without light. */
function pickTarget(gl) {
  const target = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  for (const attachment of [gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]) {
    gl.framebufferTexture2D(gl.FRAMEBUFFER, attachment, gl.TEXTURE_2D, texture(gl, null, 1, 1), 0);
  }
  const depth = gl.createRenderbuffer();
  gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
  gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, 1, 1);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
  gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
  return target;
}
