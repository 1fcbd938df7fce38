// From camera coordinates (metres; x right, y down, z ahead) to pixels.

/** The pixel of a point; null behind the camera. */
export function pixel(projection, [x, y, z]) {
  const [u, v, w] = projection.map((row) => row[0] * x + row[1] * y + row[2] * z + row[3]);
  return w > 0.1 ? [u / w, v / w] : null;
}

/** Pieces of a line that a lens bends. */
const BENT_PIECES = 12;

/** The two lenses of OpenCV: what becomes of a ray through (x, y) in the plane at depth 1. */
const LENSES = {
  brown: (x, y, [k1, k2, p1, p2, k3]) => {
    const r2 = x * x + y * y;
    const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
    return [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y];
  },
  kb4: (x, y, [k1, k2, k3, k4]) => {
    const radius = Math.hypot(x, y);
    const angle = Math.atan(radius);
    const a2 = angle * angle;
    const scale = radius > 1e-9 ? angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))) / radius : 1;
    return [x * scale, y * scale];
  },
};

/** Where a lens shows what the pinhole shows at a pixel; `lens` is as `--lens` has it, or none. */
export function shown(lens, projection, at) {
  if (!lens || !at) return at;
  const [kind, numbers] = lens.split(":");
  const { focal, center } = intrinsics(projection);
  const [x, y] = [0, 1].map((axis) => (at[axis] - center[axis]) / focal[axis]);
  return LENSES[kind](x, y, numbers.split(",").map(Number)).map((value, axis) => focal[axis] * value + center[axis]);
}

/** Places along a line that are joined by straight lines: its ends, and more where a lens bends it. */
export function places(lens, from, to) {
  const pieces = lens ? BENT_PIECES : 1;
  const at = (i) => from.map((start, axis) => start + (to[axis] - start) * i / pieces);
  return Array.from({ length: pieces + 1 }, (_, i) => at(i));
}

/** Focal lengths and principal point of a projection K [R | t]. */
function intrinsics(projection) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const last = projection[2];
  const size = dot(last, last);
  const center = [0, 1].map((axis) => dot(projection[axis], last) / size);
  const focal = [0, 1].map((axis) => {
    const across = [0, 1, 2].map((j) => projection[axis][j] - center[axis] * last[j]);
    return Math.sqrt(dot(across, across) / size);
  });
  return { focal, center };
}

/** A level camera that sees so many degrees across an image. */
export function levelProjection({ width, height }, hfovDegrees) {
  const focal = width / 2 / Math.tan(hfovDegrees * Math.PI / 360);
  return [[focal, 0, (width - 1) / 2, 0], [0, focal, (height - 1) / 2, 0], [0, 0, 1, 0]];
}

/** Corners of a box on the road, front first, then the same above them. */
export function boxCorners(object) {
  const [height, width, length] = object.dimensions_hwl;
  const [x, y, z] = object.location;
  const [sin, cos] = [Math.sin(object.rotation_y), Math.cos(object.rotation_y)];
  const flat = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([l, w]) => [l * length / 2, w * width / 2]);
  const at = (up) => flat.map(([l, w]) => [x + cos * l + sin * w, y - up, z - sin * l + cos * w]);
  return [...at(0), ...at(height)];
}

/** Edges between the corners of a box. */
export const EDGES = [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]];

/** The horizon: where two directions over the road end, far apart. */
export function horizon(projection) {
  const far = 1e6;
  return [[-3, 1], [3, 1]].map(([x, z]) => pixel(projection, [x * far, 0, z * far]));
}

/** A line across the road, so far ahead of a camera so high above it. */
export function roadLine(projection, heightM, depthM) {
  return [-1.5, 1.5].map((share) => pixel(projection, [share * depthM, heightM, depthM]));
}
