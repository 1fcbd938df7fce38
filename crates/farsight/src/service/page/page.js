import { Corners } from "./corners.js";
import { color, distance, drawAbove, drawPicture, title } from "./drawing.js";
import { watch } from "./film.js";
import { levelProjection } from "./geometry.js";

const WAIT_MS = 250;
/** How much of a track's way is shown, seconds. */
const TRAIL_S = 5;
/** The choice of the camera that four points told; no name of a stored camera is as odd. */
const MARKED = "\u0000marked";

const find = (id) => document.getElementById(id);
const [photo, above, rows, status] = ["photo", "above", "objects", "status"].map(find);

/** What is shown: the photo's file, the pixels, the objects, whose camera, who is chosen. */
const state = {
  file: null,
  image: null,
  objects: [],
  /** Projection and lens of the answer, and the field of view that was asked for. */
  answered: null,
  lens: null,
  askedHfov: null,
  chosen: null,
  trails: new Map(),
  reach: { farthest: 30, widest: 10 },
  /** The request or film on its way. */
  request: null,
  timer: 0,
  token: "",
  isFilm: false,
  /** What four points told. */
  marked: null,
};

const degrees = () => Number(find("hfov").value);
const chosenCamera = () => find("camera").value;
const key = (object) => String(object.id ?? state.objects.indexOf(object));
const headers = () => (state.token ? { Authorization: `Bearer ${state.token}` } : {});

function tell(text, isBad = false) {
  status.textContent = text;
  status.classList.toggle("bad", isBad);
}

/** The camera that is shown: that of the answer, or the one that the controls say. */
function projection() {
  const isAnswered = state.answered && (state.isFilm || chosenCamera() || state.askedHfov === degrees());
  if (isAnswered) return state.answered;
  if (chosenCamera() === MARKED) return state.marked.projection;
  return levelProjection(state.image, degrees());
}

/** What the drawings need to know. */
function view() {
  return {
    image: state.image,
    objects: state.objects,
    projection: state.image ? projection() : null,
    answered: state.answered,
    lens: state.lens,
    heightM: Number(find("height").value),
    corners: corners.points,
    cursor: corners.cursor,
    isChosen: (object) => key(object) === state.chosen,
    trail: (object) => state.trails.get(object.id)?.map(({ location }) => location) ?? [],
    reach,
  };
}

/** How far the view from above reaches; through a film it only grows, so that it does not jump. */
function reach() {
  const ends = state.objects.map((object) => (object.range_interval_m ?? [0, object.range_m])[1]);
  const sides = state.objects.map((object) => Math.abs(object.location[0]) * 1.15 + 2);
  const now = { farthest: Math.max(30, ...ends) * 1.08, widest: Math.max(10, ...sides) };
  if (state.isFilm) {
    now.farthest = Math.max(now.farthest, state.reach.farthest);
    now.widest = Math.max(now.widest, state.reach.widest);
  }
  state.reach = now;
  return now;
}

function drawAll() {
  if (state.image) drawPicture(photo, view());
  drawAbove(above, view());
}

/** Rows stay the same elements while their objects stay, so that the focus does, too. */
function listObjects() {
  find("last-column").textContent = state.isFilm ? "Closing" : "Score";
  const old = new Map([...rows.rows].map((row) => [row.dataset.key, row]));
  const kept = new Set(state.objects.map(key));
  for (const [name, row] of old) if (!kept.has(name)) row.remove();
  for (const object of state.objects) {
    const row = old.get(key(object)) ?? rows.appendChild(newRow(key(object)));
    const interval = object.range_interval_m;
    const between = interval ? `${interval[0].toFixed(1)} to ${interval[1].toFixed(1)} m` : "";
    [title(object), distance(object), between, lastCell(object)].forEach((text, place) => {
      if (row.cells[place].textContent !== text) row.cells[place].textContent = text;
    });
    row.style.setProperty("--own", color(object));
    row.setAttribute("aria-selected", String(key(object) === state.chosen));
  }
}

function lastCell(object) {
  if (!state.isFilm) return object.score.toFixed(2);
  if (object.coasting) return "hidden";
  const { closing_mps: speed, closing_sigma_mps: sigma, ttc_s: ttc } = object;
  if (speed === null) return "";
  return `${speed.toFixed(1)} ±${sigma.toFixed(1)} m/s${ttc === null ? "" : `, ${ttc.toFixed(1)} s`}`;
}

function newRow(name) {
  const row = document.createElement("tr");
  row.dataset.key = name;
  row.tabIndex = 0;
  for (let place = 0; place < 4; place += 1) row.insertCell();
  for (const event of ["focus", "click"]) row.addEventListener(event, () => choose(name));
  return row;
}

function choose(name) {
  if (state.chosen === name) return;
  state.chosen = name;
  for (const row of rows.rows) row.setAttribute("aria-selected", String(row.dataset.key === name));
  drawAll();
}

function showObjects(objects) {
  state.objects = objects;
  drawAll();
  listObjects();
}

/** Forgets what was shown, and stops what is on its way. */
function begin(isFilm) {
  state.request?.abort();
  clearTimeout(state.timer);
  const reach = { farthest: 30, widest: 10 };
  Object.assign(state, { isFilm, objects: [], answered: null, lens: null, chosen: null, reach });
  state.trails.clear();
  rows.replaceChildren();
  find("stop").hidden = !isFilm;
  showControls();
}

function showControls() {
  find("hfov-row").hidden = state.isFilm || Boolean(chosenCamera());
  // A film has a camera of its own.
  find("camera-row").hidden = state.isFilm || find("camera").options.length < 2;
}

async function asked(address, options = {}) {
  const response = await fetch(address, { ...options, headers: { ...options.headers, ...headers() } });
  const answer = await response.json().catch(() => ({}));
  find("token-row").hidden = response.status !== 401;
  if (!response.ok) throw new Error(answer.error?.message ?? `the service answered ${response.status}`);
  return answer;
}

/** What is told of an error. */
function failure(error) {
  // What fetch throws when there is nobody.
  return error instanceof TypeError ? "The service does not answer." : `${error.message}.`;
}

async function openPhoto(file) {
  find("video").value = "";
  begin(false);
  try {
    state.image = await createImageBitmap(file);
  } catch {
    state.file = null;
    tell(`${file.name}: no image that this browser can show; expected JPEG, PNG or WebP`, true);
    listObjects();
    return;
  }
  state.file = file;
  corners.clear();
  showObjects([]);
  await look();
}

function cameraQuery() {
  if (chosenCamera() === MARKED) {
    const { projection, road } = state.marked;
    return { projection: projection.flat().join(","), ...(road && { road: road.join(",") }) };
  }
  return chosenCamera() ? { camera: chosenCamera() } : { hfov: degrees() };
}

async function look() {
  if (!state.file || state.isFilm) return;
  state.request?.abort();
  const request = new AbortController();
  const hfov = degrees();
  state.request = request;
  tell("Looking …");
  try {
    const options = { method: "POST", body: state.file, signal: request.signal };
    const answer = await asked(`v1/range?${new URLSearchParams(cameraQuery())}`, options);
    const { projection: answered, lens = null } = answer.camera;
    Object.assign(state, { answered, lens, askedHfov: hfov, chosen: null });
    const count = answer.detections.length;
    tell(count ? `${count} ${count === 1 ? "object" : "objects"} found.` : "Nothing found.");
    showObjects(answer.detections);
  } catch (error) {
    if (request.signal.aborted) return;
    Object.assign(state, { answered: null, lens: null });
    tell(failure(error), true);
    showObjects([]);
  }
}

function soon() {
  clearTimeout(state.timer);
  state.timer = setTimeout(look, WAIT_MS);
}

async function openFilm(name) {
  begin(true);
  state.file = null;
  const request = new AbortController();
  state.request = request;
  tell(`${name}: begins …`);
  try {
    const end = await watch(name, {
      headers: headers(),
      signal: request.signal,
      camera: ({ projection: answered, lens }) => Object.assign(state, { answered, lens }),
      show: (image, record) => {
        if (!request.signal.aborted) showFrame(name, image, record);
      },
    });
    if (end === "failed") tell(`${name}: cannot be read; the service's log says why.`, true);
    else tell(`${name}: ended.`);
  } catch (error) {
    if (request.signal.aborted) return;
    if (error.status === 401) find("token-row").hidden = false;
    tell(`${name}: ${failure(error)}`, true);
  }
  find("stop").hidden = true;
  // Chosen again, it begins anew.
  if (state.request === request) find("video").value = "";
}

function showFrame(name, image, record) {
  if (state.image?.width !== image.width) corners.clear();
  state.image = image;
  if (!record) return;
  for (const { id, location, coasting } of record.tracks) {
    const trail = (state.trails.get(id) ?? []).filter(({ time }) => time > record.time_s - TRAIL_S);
    if (!coasting) trail.push({ time: record.time_s, location });
    state.trails.set(id, trail);
  }
  const count = record.tracks.length;
  tell(`${name}: ${record.time_s.toFixed(1)} s, ${count} ${count === 1 ? "object" : "objects"}.`);
  showObjects(record.tracks);
}

async function listCameras() {
  try {
    const { cameras, videos } = await asked("v1/cameras");
    const named = cameras.map((name) => new Option(name, name));
    find("camera").replaceChildren(new Option("by its field of view", ""), ...named);
    showControls();
    find("video").replaceChildren(new Option("none", ""), ...videos.map((name) => new Option(name, name)));
    find("video-row").hidden = videos.length === 0;
    if (!state.file) tell(videos.length ? "No photo or film yet." : "No photo yet.");
  } catch (error) {
    tell(failure(error), true);
  }
}

// Calibration with four points.

const corners = new Corners(photo, () => state.image, () => {
  if (state.image) drawPicture(photo, view());
  clearTimeout(corners.timer);
  corners.timer = setTimeout(calibrate, WAIT_MS);
});

function tellCorners(text, isBad = false) {
  find("corners-told").textContent = text;
  find("corners-told").classList.toggle("bad", isBad);
}

/** What the corners say, or what is missing. */
async function calibrate() {
  const told = JSON.stringify([corners.points, find("side-a").value, find("side-b").value]);
  if (corners.told === told) return;
  corners.told = told;
  state.measured = null;
  for (const id of ["corners-use", "corners-save"]) find(id).disabled = true;
  const count = corners.points.length;
  if (count < 4) {
    tellCorners(count ? `${count} of 4 corners.` : "No corner yet.");
    return;
  }
  const { width, height } = state.image;
  const sides = [Number(find("side-a").value), Number(find("side-b").value)];
  const question = { width, height, corners_px: corners.points, sides_m: sides, shown_px: photo.clientWidth };
  try {
    const options = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(question) };
    const answer = await asked("v1/calibrate", options);
    if (corners.told !== told) return;
    state.measured = answer;
    for (const id of ["corners-use", "corners-save"]) find(id).disabled = false;
    find("corners-use").disabled = state.isFilm;
    const error = (sigma, digits) => (sigma === null ? "" : ` ±${sigma.toFixed(digits)}`);
    const down = `looks ${Math.abs(answer.pitch_deg).toFixed(1)}° ${answer.pitch_deg < 0 ? "up" : "down"}`;
    const seen = `Field of view ${answer.hfov_deg.toFixed(1)}${error(answer.hfov_sigma_deg, 1)}°`;
    const above = `${answer.height_m.toFixed(2)}${error(answer.height_sigma_m, 2)} m above the road`;
    tellCorners(`${seen}, ${above}, ${down}; the corners are off by ${answer.residual_px.toFixed(1)} pixels.`);
  } catch (error) {
    tellCorners(failure(error), true);
  }
}

function useMarked() {
  state.marked = state.measured;
  const select = find("camera");
  if (![...select.options].some((option) => option.value === MARKED)) select.add(new Option("by four points", MARKED));
  select.value = MARKED;
  find("height").value = String(state.marked.height_m);
  showHeight();
  showControls();
  look();
}

function saveMarked() {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([state.measured.calibration], { type: "text/plain" }));
  link.download = "camera.txt";
  link.click();
  URL.revokeObjectURL(link.href);
}

function showHeight() {
  find("height-value").textContent = `${Number(find("height").value).toFixed(2)} m`;
}

function listen() {
  const drop = find("drop");
  for (const name of ["dragover", "dragleave", "drop"]) {
    document.addEventListener(name, (event) => {
      event.preventDefault();
      drop.classList.toggle("over", name === "dragover");
      if (name === "drop" && event.dataTransfer.files.length) openPhoto(event.dataTransfer.files[0]);
    });
  }
  find("file").addEventListener("change", (event) => event.target.files.length && openPhoto(event.target.files[0]));
  find("hfov").addEventListener("input", () => {
    find("hfov-value").textContent = `${degrees()}°`;
    drawAll();
    soon();
  });
  find("height").addEventListener("input", () => {
    showHeight();
    drawAll();
  });
  find("camera").addEventListener("change", () => {
    showControls();
    look();
  });
  find("video").addEventListener("change", (event) => {
    if (event.target.value) openFilm(event.target.value);
    else stop();
  });
  find("stop").addEventListener("click", stop);
  find("token-use").addEventListener("click", async () => {
    state.token = find("token").value.trim();
    await listCameras();
    await look();
  });
  rows.addEventListener("keydown", (event) => {
    const row = event.target.closest("tr");
    const next = { ArrowDown: row?.nextElementSibling, ArrowUp: row?.previousElementSibling }[event.key];
    if (next) {
      event.preventDefault();
      next.focus();
    }
  });
  find("corners-panel").addEventListener("toggle", (event) => corners.turn(event.target.open));
  find("corners-clear").addEventListener("click", () => corners.clear());
  find("corners-use").addEventListener("click", useMarked);
  find("corners-save").addEventListener("click", saveMarked);
  for (const id of ["side-a", "side-b"]) find(id).addEventListener("input", calibrate);
  addEventListener("resize", drawAll);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
}

/** Stops the film; its last frame stays. */
function stop() {
  state.request?.abort();
  find("stop").hidden = true;
  find("video").value = "";
  tell("Stopped.");
}

listen();
drawAll();
listCameras();
