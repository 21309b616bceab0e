// From where the cloud is looked at: the same angles as in the service's pictures.

const MARGIN = 0.07;
const FIELD_OF_VIEW = 30 * Math.PI / 180;

/** Directions to the right, up and towards the viewer, in the cloud's axes. */
export function axesOf({ azimuth, elevation, up }) {
  const [a, e] = [azimuth * Math.PI / 180, elevation * Math.PI / 180];
  const [sa, ca, se, ce] = [Math.sin(a), Math.cos(a), Math.sin(e), Math.cos(e)];
  const turn = { x: 2, y: 1, z: 0 }[up];
  const turned = (axis) => [0, 1, 2].map((i) => axis[(i + turn) % 3]);
  return [[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]].map(turned);
}

/** The least ball about the middle of the box around finite points. */
export function ballAround(points) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let i = 0; i < points.length; i += 1) {
    const axis = i % 3;
    if (points[i] < low[axis]) low[axis] = points[i];
    if (points[i] > high[axis]) high[axis] = points[i];
  }
  if (!(low[0] <= high[0])) return { center: [0, 0, 0], radius: 1 };
  const center = low.map((x, axis) => 0.5 * (x + high[axis]));
  let squared = 0;
  for (let i = 0; i < points.length; i += 3) {
    const d = (points[i] - center[0]) ** 2 + (points[i + 1] - center[1]) ** 2 + (points[i + 2] - center[2]) ** 2;
    if (d > squared) squared = d;
  }
  return { center, radius: Math.sqrt(squared) || 1 };
}

/** Matrices for a view of a ball, on a canvas of `width × height` pixels. Columns first, as WebGL takes them. */
export function matrices(view, ball, width, height) {
  const axes = axesOf(view);
  const extent = ball.radius / (1 - 2 * MARGIN) / view.zoom;
  const half = height < width ? [extent * width / height, extent] : [extent, extent * height / width];
  const pan = [view.x * ball.radius, view.y * ball.radius];
  const perspective = view.projection === 'perspective';
  const distance = perspective ? Math.min(...half) / Math.tan(FIELD_OF_VIEW / 2) : 0;
  const offset = axes.map((axis) => -axis.reduce((sum, x, i) => sum + x * ball.center[i], 0));
  const look = [
    axes[0][0], axes[1][0], axes[2][0], 0, axes[0][1], axes[1][1], axes[2][1], 0, axes[0][2], axes[1][2], axes[2][2], 0,
    offset[0] + pan[0], offset[1] + pan[1], offset[2] - distance, 1,
  ];
  const reach = 1.5 * ball.radius;
  const project = new Array(16).fill(0);
  if (perspective) {
    const [near, far] = [Math.max(distance - reach, 0.02 * distance, 1e-3 * ball.radius), distance + reach];
    project[0] = distance / half[0];
    project[5] = distance / half[1];
    project[10] = (far + near) / (near - far);
    project[11] = -1;
    project[14] = 2 * far * near / (near - far);
  } else {
    project[0] = 1 / half[0];
    project[5] = 1 / half[1];
    project[10] = -1 / reach;
    project[15] = 1;
  }
  return { look: new Float32Array(look), project: new Float32Array(project), half, pixels: 0.5 * height * project[5] };
}

/** The azimuth between −180° and 180°. */
export const wrapped = (degrees) => degrees - 360 * Math.round(degrees / 360);
