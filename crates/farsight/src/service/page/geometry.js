// From camera coordinates (metres; x right, y down, z ahead) to pixels.

/** The pixel of a point; null behind the camera. */
export function pixel(projection, [x, y, z]) {
  const [u, v, w] = projection.map((row) => row[0] * x + row[1] * y + row[2] * z + row[3]);
  return w > 0.1 ? [u / w, v / w] : null;
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
