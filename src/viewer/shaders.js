// What the graphics card runs. Light and its share are those of the service's pictures (picture/shading.rs).

const COLOR = `
uniform sampler2D u_table;
uniform vec2 u_range;
uniform int u_paint;
uniform vec3 u_plain, u_absent;
vec3 linear(vec3 c) { return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c)); }
vec3 encoded(vec3 c) { return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c)); }
vec3 albedo(float value, vec3 own) {
  if (u_paint == 0) return u_plain;
  if (u_paint == 2) return own;
  if (value > 2e38) return u_absent;
  float share = clamp((value - u_range.x) / max(u_range.y - u_range.x, 1e-37), 0.0, 1.0);
  return texelFetch(u_table, ivec2(int(share * 255.0 + 0.5), 0), 0).rgb;
}
vec3 lit(vec3 color, vec3 normal) {
  float facing = clamp(dot(normalize(normal), vec3(-0.41, 0.47, 0.78)), 0.0, 1.0);
  return encoded(linear(color) * (0.45 + 0.55 * facing));
}`;

const VERTEX_HEAD = `#version 300 es
precision highp float;
layout(location = 0) in vec3 a_position;
layout(location = 1) in float a_value;
layout(location = 2) in float a_radius;
layout(location = 3) in vec4 a_normal;
layout(location = 4) in vec3 a_own;
uniform mat4 u_look, u_project;
uniform float u_pixels, u_size;
uniform vec2 u_window;
out vec3 v_normal;
out vec3 v_own;
`;

/** Towards the viewer: surfaces of scans have two sides. */
const NORMAL = `
  vec3 normal = mat3(u_look) * a_normal.xyz;
  v_normal = dot(normal, normal) < 0.01 ? vec3(0.0, 0.0, 1.0) : normalize(normal);
`;

export const POINT_VERTEX = `${VERTEX_HEAD}
flat out float v_value;
flat out float v_spread;
flat out float v_radius;
flat out float v_depth;
flat out uint v_row;
void main() {
  ${NORMAL}
  vec4 eye = u_look * vec4(a_position, 1.0);
  vec3 gaze = u_project[3][3] > 0.5 ? vec3(0.0, 0.0, 1.0) : -normalize(eye.xyz);
  if (dot(v_normal, gaze) < 0.0) v_normal = -v_normal;
  v_own = a_own;
  v_value = a_value;
  v_radius = a_radius * u_size;
  v_depth = eye.z;
  v_row = uint(gl_VertexID) + 1u;
  gl_Position = u_project * eye;
  float radius = v_radius * u_pixels / gl_Position.w;
  float size = clamp(2.0 * radius, 1.5, 400.0);
  v_spread = radius < 1.0 ? 0.0 : 0.5 * size / radius;
  gl_PointSize = size;
}`;

/** A disc in its tangent plane, not as narrow where it is seen from aside as it should be: normals of scans are rough. */
/** Towards its rim it recedes, so that between discs a pixel belongs to the nearest center. */
const DISC = `
  vec2 q = (2.0 * gl_PointCoord - 1.0) * vec2(v_spread, -v_spread);
  float tilt = -dot(v_normal.xy, q) / max(v_normal.z, 0.2);
  float squared = dot(q, q) + 0.6 * tilt * tilt;
  if (squared > 1.0) discard;
  float z = v_depth + v_radius * (clamp(tilt, -2.0, 2.0) - 0.7 * squared);
  float w = u_project[2][3] * z + u_project[3][3];
  gl_FragDepth = clamp(0.5 + 0.5 * (u_project[2][2] * z + u_project[3][2]) / w, 0.0, 1.0);
`;

const POINT_IN = `
flat in float v_value;
flat in float v_spread;
flat in float v_radius;
flat in float v_depth;
flat in uint v_row;
in vec3 v_normal;
in vec3 v_own;
uniform mat4 u_project;
`;

export const POINT_FRAGMENT = `#version 300 es
precision highp float;
${POINT_IN}${COLOR}
out vec4 color;
void main() {
  ${DISC}
  color = vec4(lit(albedo(v_value, v_own), v_normal), 1.0);
}`;

/** The row, in the bytes of a pixel, and its color without light. */
export const PICK_FRAGMENT = `#version 300 es
precision highp float;
${POINT_IN}${COLOR}
layout(location = 0) out vec4 row;
layout(location = 1) out vec4 color;
void main() {
  ${DISC}
  row = vec4(uvec4(v_row, v_row >> 8, v_row >> 16, v_row >> 24) & 255u) / 255.0;
  color = vec4(albedo(v_value, v_own), 1.0);
}`;

export const FACE_VERTEX = `${VERTEX_HEAD}
out float v_value;
void main() {
  ${NORMAL}
  v_own = a_own;
  v_value = a_value;
  gl_Position = u_project * u_look * vec4(a_position, 1.0);
}`;

export const FACE_FRAGMENT = `#version 300 es
precision highp float;
in float v_value;
in vec3 v_normal;
in vec3 v_own;
${COLOR}
out vec4 color;
void main() {
  vec3 normal = v_normal.z < 0.0 ? -v_normal : v_normal;
  color = vec4(lit(albedo(v_value, v_own), normal), 1.0);
}`;

/** A mark is seen whole unless something lies before its middle by more than its size: no surface cuts it. */
export const MARK_VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 a_position;
layout(location = 1) in float a_label;
uniform mat4 u_look, u_project;
uniform float u_pixels, u_size;
uniform highp sampler2D u_depth;
flat out float v_label;
void main() {
  vec4 eye = u_look * vec4(a_position, 1.0);
  gl_Position = u_project * eye;
  eye.z += u_size / u_pixels * gl_Position.w;
  vec4 before = u_project * eye;
  vec2 place = (0.5 + 0.5 * gl_Position.xy / gl_Position.w) * vec2(textureSize(u_depth, 0));
  float seen = texelFetch(u_depth, ivec2(place), 0).r;
  if (seen < 0.5 + 0.5 * before.z / before.w) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = u_size;
  v_label = a_label;
}`;

export const MARK_FRAGMENT = `#version 300 es
precision highp float;
flat in float v_label;
uniform sampler2D u_labels;
uniform float u_columns;
uniform vec3 u_color;
out vec4 color;
void main() {
  vec2 q = 2.0 * gl_PointCoord - 1.0;
  float d = length(q);
  if (d > 1.0) discard;
  vec2 cell = vec2(mod(v_label, u_columns), floor(v_label / u_columns));
  float ink = texture(u_labels, (cell + gl_PointCoord) / u_columns).a;
  float ring = smoothstep(0.76, 0.82, d);
  color = vec4(mix(u_color, vec3(1.0), max(ink, ring)), 1.0);
  if (v_label < 0.0) { if (d < 0.6) discard; color = vec4(mix(vec3(0.0), vec3(1.0), step(0.8, d)), 1.0); }
}`;
