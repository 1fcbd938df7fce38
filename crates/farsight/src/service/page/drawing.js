// The picture with what was found in it, and the same from above.

import { EDGES, boxCorners, horizon, pixel, places, roadLine, shown } from "./geometry.js";

const COLORS = { Car: "#4da3ff", Van: "#37c2b4", Truck: "#ff9f40", Pedestrian: "#ff5f7e", Cyclist: "#c98bff" };
const OTHER_COLOR = "#9bd14b";
const ROAD_COLOR = "#ffe14d";
const MARK_COLOR = "#ff4fd8";
const MARKS_M = [10, 20, 40];
const LONGEST_SIDE = 1920;
/** On a picture that is shown smaller than this, error bars are left to the list. */
const SMALL_PX = 600;

export const color = (object) => COLORS[object.class] ?? OTHER_COLOR;

/** What an object is called: `#7 Car`. */
export const title = (object) => (object.id === undefined ? object.class : `#${object.id} ${object.class}`);

/** Distance and error bar, metres. */
export function distance(object) {
  const sigma = object.range_sigma_m === null ? "" : ` ±${object.range_sigma_m.toFixed(1)}`;
  return `${object.range_m.toFixed(1)}${sigma} m`;
}

/** Draws the picture: its road, its objects, its marked corners. */
export function drawPicture(canvas, view) {
  const { width, height } = view.image;
  const scale = Math.min(1, LONGEST_SIDE / Math.max(width, height));
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  const context = canvas.getContext("2d");
  context.drawImage(view.image, 0, 0, canvas.width, canvas.height);
  context.scale(scale, scale);
  // What a pixel of the page is in pixels of the image, so that labels can be read on a phone, too.
  const unit = width / Math.max(canvas.clientWidth, 1);
  const pen = { context, unit, width, labels: [], isSmall: canvas.clientWidth < SMALL_PX };
  drawRoad(pen, view);
  // Near ones last, over what is behind them.
  const order = [...view.objects].sort((a, b) => b.range_m - a.range_m);
  order.forEach((object) => drawBox(pen, view, object));
  // And their labels first, where there is no room for all.
  order.reverse().forEach((object) => drawTitle(pen, object));
  view.corners.forEach((corner, place) => drawCorner(pen, corner, place, view.corners));
  if (view.cursor) drawCursor(pen, view.cursor);
  const list = view.objects.map((object) => `${title(object)} ${distance(object)}`).join(", ");
  canvas.setAttribute("aria-label", list ? `Picture with ${list}` : "Picture");
}

/** The horizon, and distances on the road below it. */
function drawRoad(pen, view) {
  const { projection, heightM } = view;
  drawRoadLine(pen, view, horizon(projection), [10, 6], "horizon");
  for (const depth of MARKS_M) drawRoadLine(pen, view, roadLine(projection, heightM, depth), [2, 6], `${depth} m`);
}

function drawRoadLine(pen, { image, lens, projection }, [from, to], dash, text) {
  if (!from || !to) return;
  const { context, unit } = pen;
  // As far as the picture reaches, whatever the line's ends are.
  const row = (column) => from[1] + (to[1] - from[1]) * (column - from[0]) / (to[0] - from[0]);
  const [left, right] = dash[0] === 10 ? [0, image.width] : [Math.max(from[0], 0), Math.min(to[0], image.width)];
  if (!(left < right) || Math.min(row(left), row(right)) > image.height) return;
  context.setLineDash(dash.map((length) => length * unit));
  context.lineWidth = 1.5 * unit;
  context.strokeStyle = ROAD_COLOR;
  const points = places(lens, [left, row(left)], [right, row(right)]).map((at) => shown(lens, projection, at));
  stroke(context, points);
  context.setLineDash([]);
  drawLabel(pen, text, points[0][0] + 4 * unit, points[0][1], ROAD_COLOR, false);
}

function stroke(context, points) {
  context.beginPath();
  points.forEach(([x, y], place) => context[place ? "lineTo" : "moveTo"](x, y));
  context.stroke();
}

/** A label above a point; where there is one already, farther up. None without room, or if it may not move. */
function drawLabel(pen, text, x, y, background, mayMove = true) {
  const { context, unit, labels } = pen;
  context.font = `${Math.round(13 * unit)}px system-ui, sans-serif`;
  const [width, height] = [context.measureText(text).width + 6 * unit, 17 * unit];
  const left = Math.max(0, Math.min(x, pen.width - width));
  let top = y - height;
  const isTaken = ([l, t, r, b]) => left < r && left + width > l && top < b && top + height > t;
  while (mayMove && top > 0 && labels.some(isTaken)) top -= height / 2;
  top = Math.max(0, top);
  if (labels.some(isTaken)) return;
  labels.push([left, top, left + width, top + height]);
  context.fillStyle = background;
  context.fillRect(left, top, width, height);
  context.fillStyle = "#101010";
  context.fillText(text, left + 3 * unit, top + 13 * unit);
}

function drawBox(pen, view, object) {
  const { context, unit } = pen;
  const corners = boxCorners(object);
  context.strokeStyle = color(object);
  context.setLineDash(object.coasting ? [4 * unit, 4 * unit] : []);
  context.lineWidth = (view.isChosen(object) ? 4 : 2) * unit;
  for (const [a, b] of EDGES) {
    const points = places(view.lens, corners[a], corners[b]).map((place) => pixel(view.answered, place));
    if (points.every(Boolean)) stroke(context, points.map((at) => shown(view.lens, view.answered, at)));
  }
  context.setLineDash([]);
}

function drawTitle(pen, object) {
  const number = object.id === undefined ? "" : `#${object.id} `;
  const text = pen.isSmall ? object.range_m.toFixed(1) : number + distance(object);
  drawLabel(pen, text, object.box2d[0], object.box2d[1], color(object));
}

function drawCorner(pen, [x, y], place, corners) {
  const { context, unit } = pen;
  context.strokeStyle = MARK_COLOR;
  context.lineWidth = 2 * unit;
  const next = corners[(place + 1) % corners.length];
  if (next && (corners.length === 4 || place + 1 < corners.length)) stroke(context, [[x, y], next]);
  context.beginPath();
  context.arc(x, y, 5 * unit, 0, 2 * Math.PI);
  context.stroke();
  drawLabel(pen, String(place + 1), x + 6 * unit, y - 4 * unit, MARK_COLOR);
}

function drawCursor({ context, unit }, [x, y]) {
  context.strokeStyle = MARK_COLOR;
  context.lineWidth = 1.5 * unit;
  stroke(context, [[x - 14 * unit, y], [x + 14 * unit, y]]);
  stroke(context, [[x, y - 14 * unit], [x, y + 14 * unit]]);
}

/** Draws objects, their error bars and the ways that they came, from above. */
export function drawAbove(canvas, view) {
  const width = Math.max(240, canvas.parentElement.clientWidth - 24);
  const height = Math.round(Math.min(width * 1.1, 720));
  // As sharp as the screen; all below is in pixels of the page.
  const ratio = devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const style = getComputedStyle(document.documentElement);
  const [back, soft, line, text] = ["panel", "soft", "line", "text"].map((name) => style.getPropertyValue(`--${name}`));
  context.fillStyle = back;
  context.fillRect(0, 0, width, height);
  const { farthest, widest } = view.reach();
  const scale = Math.min((height - 40) / farthest, width / 2 / widest);
  const at = ([x, , z]) => [width / 2 + x * scale, height - 24 - z * scale];
  context.font = "13px system-ui, sans-serif";
  const step = farthest > 80 ? 20 : 10;
  for (let z = step; z < farthest; z += step) {
    context.strokeStyle = line;
    stroke(context, [[0, at([0, 0, z])[1]], [width, at([0, 0, z])[1]]]);
    context.fillStyle = soft;
    context.fillText(`${z} m`, 4, at([0, 0, z])[1] - 3);
  }
  context.fillStyle = text;
  context.beginPath();
  context.moveTo(...at([0, 0, 0]));
  context.lineTo(width / 2 - 7, height - 8);
  context.lineTo(width / 2 + 7, height - 8);
  context.fill();
  for (const object of view.objects) drawFromAbove({ context, at }, view, object);
  context.fillStyle = text;
  labelFromAbove({ context, at, width }, view);
  canvas.setAttribute("aria-label", `${view.objects.length} objects seen from above`);
}

/** Distances beside the objects, the nearest first; where there is no room for one, the list has it. */
function labelFromAbove({ context, at, width }, view) {
  const taken = [];
  for (const object of [...view.objects].sort((a, b) => a.range_m - b.range_m)) {
    const label = object.range_m.toFixed(1);
    const [x, y] = at(object.location);
    const length = context.measureText(label).width;
    const isFree = (left) => left > 0 && left + length < width
      && !taken.some(([l, t]) => left < l + length + 4 && l < left + length + 4 && Math.abs(t - y) < 14);
    const left = [x + 8, x - 8 - length].find(isFree);
    if (left === undefined) continue;
    taken.push([left, y]);
    context.fillText(label, left, y + 4);
  }
}

function drawFromAbove({ context, at }, view, object) {
  context.strokeStyle = color(object);
  context.lineWidth = 1.5;
  context.globalAlpha = 0.6;
  stroke(context, view.trail(object).map(at));
  context.globalAlpha = 1;
  context.lineWidth = view.isChosen(object) ? 4 : 2;
  context.setLineDash(object.coasting ? [4, 4] : []);
  const corners = boxCorners(object).slice(0, 4);
  stroke(context, [...corners, corners[0]].map(at));
  context.setLineDash([]);
  const [x, y, z] = object.location;
  context.lineWidth = 1.5;
  if (object.range_interval_m) {
    // Along the ray of the object, as far as the interval goes.
    stroke(context, object.range_interval_m.map((end) => at([x * end / object.range_m, y, z * end / object.range_m])));
  }
  if (object.velocity_mps) {
    // Where it is in a second, relative to the camera.
    const [vx, , vz] = object.velocity_mps;
    stroke(context, [at([x, y, z]), at([x + vx, y, z + vz])]);
  }
}
