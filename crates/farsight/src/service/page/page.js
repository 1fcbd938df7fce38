const COLORS = { Car: "#4da3ff", Van: "#37c2b4", Truck: "#ff9f40", Pedestrian: "#ff5f7e", Cyclist: "#c98bff" };
const OTHER_COLOR = "#9bd14b";
const MARKS_M = [10, 20, 40];
const LONGEST_SIDE = 1920;
const WAIT_MS = 250;
/** On a photo that is shown smaller than this, error bars are left to the list. */
const SMALL_PX = 600;

const find = (id) => document.getElementById(id);
const [photo, above, objects, status] = ["photo", "above", "objects", "status"].map(find);

/** What is shown: the file, its pixels, the answer, the object that is chosen, the request on its way. */
const state = { file: null, image: null, answer: null, chosen: -1, request: null, timer: 0, token: "" };

const color = (object) => COLORS[object.class] ?? OTHER_COLOR;
const degrees = () => Number(find("hfov").value);
const namedCamera = () => find("camera").value;

function tell(text, isBad = false) {
  status.textContent = text;
  status.classList.toggle("bad", isBad);
}

/** Distance and error bar, metres. */
function distance(object) {
  const sigma = object.range_sigma_m === null ? "" : ` ±${object.range_sigma_m.toFixed(1)}`;
  return `${object.range_m.toFixed(1)}${sigma} m`;
}

/** The pixel of a point in camera coordinates; null behind the camera. */
function pixel(projection, [x, y, z]) {
  const [u, v, w] = projection.map((row) => row[0] * x + row[1] * y + row[2] * z + row[3]);
  return w > 0.1 ? [u / w, v / w] : null;
}

/** Corners on the road, front first, then the same above them. */
function corners(object) {
  const [height, width, length] = object.dimensions_hwl;
  const [x, y, z] = object.location;
  const [sin, cos] = [Math.sin(object.rotation_y), Math.cos(object.rotation_y)];
  const flat = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([l, w]) => [l * length / 2, w * width / 2]);
  const at = (up) => flat.map(([l, w]) => [x + cos * l + sin * w, y - up, z - sin * l + cos * w]);
  return [...at(0), ...at(height)];
}

const EDGES = [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]];

/** The camera that is shown: that of the answer, or the one that the slider says. */
function projection() {
  const { width, height } = state.image;
  if (state.answer && (namedCamera() || state.answer.hfov === degrees())) return state.answer.camera.projection;
  const focal = width / 2 / Math.tan(degrees() * Math.PI / 360);
  return [[focal, 0, (width - 1) / 2, 0], [0, focal, (height - 1) / 2, 0], [0, 0, 1, 0]];
}

function drawPhoto() {
  if (!state.image) return;
  const { width, height } = state.image;
  const scale = Math.min(1, LONGEST_SIDE / Math.max(width, height));
  photo.width = Math.round(width * scale);
  photo.height = Math.round(height * scale);
  const pen = photo.getContext("2d");
  pen.drawImage(state.image, 0, 0, photo.width, photo.height);
  pen.scale(scale, scale);
  // What a pixel of the page is in pixels of the image, so that labels can be read on a phone, too.
  const unit = width / Math.max(photo.clientWidth, 1);
  labels.length = 0;
  drawRoad(pen, unit);
  const found = state.answer ? state.answer.detections : [];
  // Near ones last, over what is behind them.
  [...found.keys()].sort((a, b) => found[b].range_m - found[a].range_m).forEach((index) => drawBox(pen, index, unit));
  const list = found.map((object) => `${object.class} ${distance(object)}`).join(", ");
  photo.setAttribute("aria-label", found.length ? `Photo with ${list}` : "Photo");
}

/** The horizon of a level camera, and distances on the road below it. */
function drawRoad(pen, unit) {
  const camera = projection();
  const line = (row, dash, text) => {
    pen.setLineDash(dash.map((length) => length * unit));
    pen.lineWidth = 1.5 * unit;
    pen.strokeStyle = "#ffe14d";
    pen.beginPath();
    pen.moveTo(0, row);
    pen.lineTo(state.image.width, row);
    pen.stroke();
    pen.setLineDash([]);
    label(pen, text, 4 * unit, row, "#ffe14d", unit, false);
  };
  line(camera[1][2] / camera[2][2], [10, 6], "horizon");
  for (const depth of MARKS_M) {
    const mark = pixel(camera, [0, Number(find("height").value), depth]);
    if (mark && mark[1] < state.image.height) line(mark[1], [2, 6], `${depth} m`);
  }
}

/** Where labels are already: left, top, right, bottom. */
const labels = [];

/** A label above a point; where there is one already, farther up, or none if it may not move. */
function label(pen, text, x, y, background, unit, mayMove = true) {
  pen.font = `${Math.round(13 * unit)}px system-ui, sans-serif`;
  const [width, height] = [pen.measureText(text).width + 6 * unit, 17 * unit];
  const left = Math.max(0, Math.min(x, state.image.width - width));
  let top = y - height;
  const isTaken = ([l, t, r, b]) => left < r && left + width > l && top < b && top + height > t;
  if (!mayMove && labels.some(isTaken)) return;
  while (top > 0 && labels.some(isTaken)) top -= height / 2;
  top = Math.max(0, top);
  labels.push([left, top, left + width, top + height]);
  pen.fillStyle = background;
  pen.fillRect(left, top, width, height);
  pen.fillStyle = "#101010";
  pen.fillText(text, left + 3 * unit, top + 13 * unit);
}

function drawBox(pen, index, unit) {
  const object = state.answer.detections[index];
  const points = corners(object).map((corner) => pixel(state.answer.camera.projection, corner));
  pen.strokeStyle = color(object);
  pen.lineWidth = (index === state.chosen ? 4 : 2) * unit;
  for (const [a, b] of EDGES) {
    if (!points[a] || !points[b]) continue;
    pen.beginPath();
    pen.moveTo(...points[a]);
    pen.lineTo(...points[b]);
    pen.stroke();
  }
  const isSmall = photo.clientWidth < SMALL_PX;
  const text = isSmall ? object.range_m.toFixed(1) : distance(object);
  label(pen, text, object.box2d[0], object.box2d[1], color(object), unit);
}

function drawAbove() {
  above.width = Math.max(240, above.parentElement.clientWidth - 24);
  above.height = Math.round(Math.min(above.width * 1.1, 720));
  const pen = above.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  const [back, soft, line, text] = ["panel", "soft", "line", "text"].map((name) => style.getPropertyValue(`--${name}`));
  const { width, height } = above;
  pen.fillStyle = back;
  pen.fillRect(0, 0, width, height);
  const found = state.answer ? state.answer.detections : [];
  const farthest = Math.max(30, ...found.map((object) => (object.range_interval_m ?? [0, object.range_m])[1])) * 1.08;
  const widest = Math.max(10, ...found.map((object) => Math.abs(object.location[0]) * 1.15 + 2));
  const scale = Math.min((height - 40) / farthest, width / 2 / widest);
  const at = (x, z) => [width / 2 + x * scale, height - 24 - z * scale];
  pen.font = "13px system-ui, sans-serif";
  const step = farthest > 80 ? 20 : 10;
  for (let z = step; z < farthest; z += step) {
    pen.strokeStyle = line;
    pen.beginPath();
    pen.moveTo(0, at(0, z)[1]);
    pen.lineTo(width, at(0, z)[1]);
    pen.stroke();
    pen.fillStyle = soft;
    pen.fillText(`${z} m`, 4, at(0, z)[1] - 3);
  }
  pen.fillStyle = text;
  pen.beginPath();
  pen.moveTo(...at(0, 0));
  pen.lineTo(width / 2 - 7, height - 8);
  pen.lineTo(width / 2 + 7, height - 8);
  pen.fill();
  found.forEach((object, index) => {
    pen.strokeStyle = color(object);
    pen.lineWidth = index === state.chosen ? 4 : 2;
    pen.beginPath();
    corners(object).slice(0, 4).forEach(([x, , z], place) => pen[place ? "lineTo" : "moveTo"](...at(x, z)));
    pen.closePath();
    pen.stroke();
    const [x, , z] = object.location;
    if (object.range_interval_m) {
      // Along the ray of the object, as far as the interval goes.
      pen.lineWidth = 1.5;
      pen.beginPath();
      object.range_interval_m.forEach((end, place) => {
        const share = end / object.range_m;
        pen[place ? "lineTo" : "moveTo"](...at(x * share, z * share));
      });
      pen.stroke();
    }
    pen.fillStyle = text;
    pen.fillText(object.range_m.toFixed(1), at(x, z)[0] + 8, at(x, z)[1] + 4);
  });
  above.setAttribute("aria-label", `${found.length} objects seen from above`);
}

function listObjects() {
  const found = state.answer ? state.answer.detections : [];
  objects.replaceChildren(...found.map((object, index) => {
    const row = document.createElement("tr");
    row.tabIndex = 0;
    row.setAttribute("aria-selected", String(index === state.chosen));
    const interval = object.range_interval_m;
    const between = interval ? `${interval[0].toFixed(1)} to ${interval[1].toFixed(1)} m` : "";
    for (const text of [object.class, distance(object), between, object.score.toFixed(2)]) {
      row.insertCell().textContent = text;
    }
    row.cells[0].style.borderLeft = `0.4rem solid ${color(object)}`;
    row.addEventListener("focus", () => choose(index));
    row.addEventListener("click", () => choose(index));
    return row;
  }));
}

function choose(index) {
  if (state.chosen === index) return;
  state.chosen = index;
  [...objects.rows].forEach((row, place) => row.setAttribute("aria-selected", String(place === index)));
  drawPhoto();
  drawAbove();
}

function drawAll() {
  drawPhoto();
  drawAbove();
  listObjects();
}

const headers = () => (state.token ? { Authorization: `Bearer ${state.token}` } : {});

async function asked(address, options = {}) {
  const response = await fetch(address, { ...options, headers: headers() });
  const answer = await response.json().catch(() => ({}));
  if (response.status === 401) find("token-row").hidden = false;
  if (!response.ok) throw new Error(answer.error?.message ?? `the service answered ${response.status}`);
  return answer;
}

async function open(file) {
  state.request?.abort();
  try {
    state.image = await createImageBitmap(file);
  } catch {
    tell(`${file.name}: no image that this browser can show; expected JPEG, PNG or WebP`, true);
    return;
  }
  Object.assign(state, { file, answer: null, chosen: -1 });
  drawAll();
  await look();
}

async function look() {
  if (!state.file) return;
  state.request?.abort();
  const request = new AbortController();
  const hfov = degrees();
  const camera = namedCamera() ? { camera: namedCamera() } : { hfov };
  state.request = request;
  tell("Looking …");
  try {
    const options = { method: "POST", body: state.file, signal: request.signal };
    const answer = await asked(`v1/range?${new URLSearchParams(camera)}`, options);
    state.answer = { ...answer, hfov };
    state.chosen = -1;
    const count = answer.detections.length;
    tell(count ? `${count} ${count === 1 ? "object" : "objects"} found.` : "Nothing found.");
  } catch (error) {
    if (request.signal.aborted) return;
    state.answer = null;
    tell(error instanceof TypeError ? "The service does not answer." : error.message, true);
  }
  drawAll();
}

function soon() {
  clearTimeout(state.timer);
  state.timer = setTimeout(look, WAIT_MS);
}

async function listCameras() {
  try {
    const { cameras } = await asked("v1/cameras");
    const options = ["", ...cameras].map((name) => new Option(name || "by its field of view", name));
    find("camera").replaceChildren(...options);
    find("camera-row").hidden = cameras.length === 0;
    if (!state.file) tell("No photo yet.");
  } catch (error) {
    tell(error.message, true);
  }
}

function listen() {
  const drop = find("drop");
  for (const name of ["dragover", "dragleave", "drop"]) {
    document.addEventListener(name, (event) => {
      event.preventDefault();
      drop.classList.toggle("over", name === "dragover");
      if (name === "drop" && event.dataTransfer.files.length) open(event.dataTransfer.files[0]);
    });
  }
  find("file").addEventListener("change", (event) => event.target.files.length && open(event.target.files[0]));
  find("hfov").addEventListener("input", () => {
    find("hfov-value").textContent = `${degrees()}°`;
    drawPhoto();
    soon();
  });
  find("height").addEventListener("input", (event) => {
    find("height-value").textContent = `${Number(event.target.value).toFixed(2)} m`;
    drawPhoto();
  });
  find("camera").addEventListener("change", () => {
    find("hfov-row").hidden = Boolean(namedCamera());
    look();
  });
  find("token-use").addEventListener("click", async () => {
    state.token = find("token").value.trim();
    await listCameras();
    await look();
  });
  objects.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    const next = step && objects.rows[state.chosen + step];
    if (next) {
      event.preventDefault();
      next.focus();
    }
  });
  addEventListener("resize", () => {
    drawPhoto();
    drawAbove();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAbove);
}

listen();
drawAbove();
listCameras();
