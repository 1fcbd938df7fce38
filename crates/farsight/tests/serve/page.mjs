// Uses the page as people do: node page.mjs ADDRESS GUARDED TOKEN CHROMIUM PHOTO, where the service at GUARDED asks for
// TOKEN. Pictures go to `pictures` beside it.

import assert from "node:assert/strict";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { chromium } from "playwright-core";

const [address, guarded, token, executablePath, photo] = process.argv.slice(2);
const TIMEOUT_MS = 180_000;
mkdirSync("pictures", { recursive: true });
const browser = await chromium.launch({ executablePath, args: ["--no-sandbox"] });

async function opened(options = {}, at = address) {
  const viewport = { width: 1280, height: 900 };
  const context = await browser.newContext({ viewport, acceptDownloads: true, ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(TIMEOUT_MS);
  page.problems = [];
  page.on("pageerror", (error) => page.problems.push(String(error)));
  page.on("console", (message) => {
    // The browser itself tells of answers that are errors.
    const isOwn = !message.text().startsWith("Failed to load resource");
    if (message.type() === "error" && isOwn) page.problems.push(message.text());
  });
  page.on("request", (request) => {
    const isOwn = [at, "blob:", "data:"].some((start) => request.url().startsWith(start));
    if (!isOwn) page.problems.push(`asks elsewhere: ${request.url()}`);
  });
  await page.goto(at);
  return page;
}

const told = (page) => page.locator("#status").textContent();
const until = (page, pattern) => page.waitForFunction(
  (source) => new RegExp(source).test(document.getElementById("status").textContent), pattern.source);
const isBad = (page) => page.locator("#status").evaluate((line) => line.classList.contains("bad"));
const cells = (page) => page.locator("#objects tr").evaluateAll(
  (rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent)));

const CAR = [77, 163, 255];
const ROAD = [255, 225, 77];

/** Pixels of a canvas that have a colour: how many, and their mean row. */
const pixelsLike = (page, color, canvas = "#photo") => page.locator(canvas).evaluate((canvas, wanted) => {
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let [count, rows] = [0, 0];
  for (let at = 0; at < data.length; at += 4) {
    if (!wanted.every((value, i) => Math.abs(data[at + i] - value) < 12)) continue;
    count += 1;
    rows += Math.floor(at / 4 / canvas.width);
  }
  return { count, row: rows / count };
}, color);

async function photoIsMeasured() {
  const page = await opened();
  await page.setInputFiles("#file", photo);
  await until(page, /objects? found/);
  const before = await cells(page);
  assert.ok(before.length > 1, JSON.stringify(before));
  assert.match(before[0][1], /^\d+\.\d ±\d+\.\d m$/);
  assert.match(before[0][2], /^\d+\.\d to \d+\.\d m$/);
  assert.ok((await pixelsLike(page, ROAD)).count > 300, "no horizon is drawn");
  assert.ok((await pixelsLike(page, CAR)).count > 100, "no box of a car is drawn");
  assert.ok((await pixelsLike(page, CAR, "#above")).count > 100, "no car is drawn from above");
  await page.screenshot({ path: "pictures/photo.png", fullPage: true });
  // The keyboard: the slider, and the list.
  await page.focus("#hfov");
  for (let step = 0; step < 20; step += 1) await page.keyboard.press("ArrowRight");
  assert.equal(await page.locator("#hfov-value").textContent(), "75°");
  const isNew = (old) => document.querySelector("#objects td:nth-child(2)")?.textContent !== old;
  await page.waitForFunction(isNew, before[0][1]);
  await until(page, /objects? found/);
  await page.focus("#objects tr");
  await page.keyboard.press("ArrowDown");
  assert.equal(await page.locator("#objects tr:nth-child(2)").getAttribute("aria-selected"), "true");
  // A file that is no image, and a service that is gone.
  await page.setInputFiles("#file", { name: "note.txt", mimeType: "text/plain", buffer: Buffer.from("no image") });
  await until(page, /note.txt: no image/);
  assert.ok(await isBad(page));
  await page.setInputFiles("#file", photo);
  await until(page, /objects? found/);
  await page.route("**/v1/range*", (route) => route.abort());
  await page.focus("#hfov");
  await page.keyboard.press("ArrowLeft");
  await until(page, /does not answer/);
  assert.ok(await isBad(page));
  await page.screenshot({ path: "pictures/error.png", fullPage: true });
  await page.unroute("**/v1/range*");
  const full = { status: 429, json: { error: { message: "the queue is full" } } };
  await page.route("**/v1/range*", (route) => route.fulfill(full));
  await page.keyboard.press("ArrowLeft");
  await until(page, /the queue is full/);
  assert.deepEqual(page.problems, []);
  await page.context().close();
}

/** A photo that is dropped, with a camera that the service knows. */
async function photoIsDropped() {
  const page = await opened();
  const dropped = await page.evaluateHandle((bytes) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([Uint8Array.from(bytes)], "dropped.jpg", { type: "image/jpeg" }));
    return transfer;
  }, [...readFileSync(photo)]);
  const isOver = () => page.locator("#drop").evaluate((place) => place.classList.contains("over"));
  await page.dispatchEvent("#drop", "dragover", { dataTransfer: dropped });
  assert.ok(await isOver(), "nothing shows that it may be dropped here");
  const asked = page.waitForRequest(/v1\/range/);
  await page.dispatchEvent("#drop", "drop", { dataTransfer: dropped });
  assert.equal(new URL((await asked).url()).search, "?hfov=65");
  assert.ok(!await isOver());
  await until(page, /objects? found/);
  const before = await cells(page);
  const again = page.waitForRequest(/v1\/range/);
  await page.selectOption("#camera", "dash");
  assert.equal(new URL((await again).url()).search, "?camera=dash");
  assert.ok(await page.locator("#hfov-row").isHidden(), "a field of view is asked for that the camera has");
  await page.waitForFunction((old) => {
    const now = document.querySelector("#objects td:nth-child(2)")?.textContent;
    return now && now !== old;
  }, before[0][1]);
  await until(page, /objects? found/);
  assert.ok((await pixelsLike(page, ROAD)).count > 300, "no horizon of the stored camera is drawn");
  await page.screenshot({ path: "pictures/camera.png", fullPage: true });
  assert.deepEqual(page.problems, []);
  await page.context().close();
}

async function tokenIsAskedFor() {
  const page = await opened({}, guarded);
  await until(page, /no token, or another one/);
  assert.ok(await isBad(page));
  assert.ok(await page.locator("#token-row").isVisible());
  await page.screenshot({ path: "pictures/token.png", fullPage: true });
  await page.fill("#token", "another word that is no token");
  const refused = page.waitForResponse(/v1\/cameras/);
  await page.click("#token-use");
  assert.equal((await refused).status(), 401);
  await until(page, /no token, or another one/);
  await page.fill("#token", token);
  await page.click("#token-use");
  await until(page, /No photo or film yet/);
  assert.ok(!await isBad(page));
  assert.ok(await page.locator("#token-row").isHidden(), "a token is asked for that was given");
  await page.setInputFiles("#file", photo);
  await until(page, /objects? found/);
  await page.selectOption("#video", "front");
  await until(page, /front: ended/);
  assert.equal((await cells(page)).length, 1);
  assert.deepEqual(page.problems, []);
  await page.context().close();
}

async function filmIsFollowed() {
  const page = await opened({ colorScheme: "dark" });
  assert.equal((await pixelsLike(page, CAR, "#above")).count, 0);
  await page.selectOption("#video", "front");
  await until(page, /front: [12]\.\d s, 1 object/);
  assert.ok(await page.locator("#stop").isVisible());
  const [[name, range, , closing]] = await cells(page);
  assert.equal(name, "#7 Car");
  assert.match(range, /^[12]\d\.\d ±1\.0 m$/);
  assert.match(closing, /^5\.0 ±0\.5 m\/s, \d\.\d s$/);
  // Its box, its error bar, where it is in a second; and its way, in a paler colour.
  const far = await pixelsLike(page, CAR, "#above");
  assert.ok(far.count > 100, `${far.count} pixels of a track are drawn from above`);
  await page.locator("#objects tr").first().focus();
  await page.screenshot({ path: "pictures/film-dark.png", fullPage: true });
  await until(page, /front: (2\.\d s|ended)/);
  assert.equal(await page.evaluate(() => document.activeElement.dataset.key), "7", "the focus stays through frames");
  await until(page, /front: ended/);
  const near = await pixelsLike(page, CAR, "#above");
  assert.ok(near.row > far.row + 10, `the car came nearer, from row ${far.row} to ${near.row}`);
  await page.selectOption("#video", "broken");
  await until(page, /broken: cannot be read/);
  assert.ok(await isBad(page));
  await page.selectOption("#video", "front");
  await until(page, /front: \d\.\d s/);
  await page.click("#stop");
  assert.equal(await told(page), "Stopped.");
  assert.deepEqual(page.problems, []);
  await page.context().close();
}

async function cornersCalibrate() {
  const page = await opened();
  await page.setInputFiles("#file", photo);
  await until(page, /objects? found/);
  await page.click("#corners-panel summary");
  const box = await page.locator("#photo").boundingBox();
  const press = (x, y) => page.locator("#photo").click({ position: { x: x * box.width, y: y * box.height } });
  await press(0.4, 0.9);
  await press(0.7, 0.9);
  await press(0.58, 0.62);
  await page.waitForFunction(() => /3 of 4/.test(document.getElementById("corners-told").textContent));
  // The last one by the keyboard.
  await page.focus("#photo");
  for (let step = 0; step < 3; step += 1) await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("Shift+ArrowUp");
  await page.keyboard.press("Enter");
  await page.keyboard.press("Backspace");
  await press(0.47, 0.62);
  await page.fill("#side-a", "3.4");
  await page.fill("#side-b", "9");
  await page.waitForFunction(() => /Field of view/.test(document.getElementById("corners-told").textContent));
  const [download] = await Promise.all([page.waitForEvent("download"), page.click("#corners-save")]);
  assert.equal(download.suggestedFilename(), "camera.txt");
  const calibration = readFileSync(await download.path(), "utf8");
  assert.match(calibration, /^P2:( -?\d\.\d+e[+-]\d+){12}\nroad:( -?\d\.\d+e[+-]\d+){6}\n/);
  const asked = page.waitForRequest((request) => new URL(request.url()).searchParams.has("projection"));
  await page.click("#corners-use");
  const road = new URL((await asked).url()).searchParams.get("road").split(",").map(Number);
  const saved = calibration.match(/road:(.*)/)[1].trim().split(" ").map(Number);
  const isSaved = (value, i) => Math.abs(value - saved[i]) < 1e-9;
  assert.ok(road.length === 6 && road.every(isSaved), `${road}, ${saved} in the file`);
  await page.waitForFunction(() => document.getElementById("camera").selectedOptions[0].text === "by four points");
  await until(page, /found/);
  await page.screenshot({ path: "pictures/corners.png", fullPage: true });
  await page.fill("#side-a", "0");
  await page.waitForFunction(() => document.getElementById("corners-told").classList.contains("bad"));
  writeFileSync("pictures/camera.txt", calibration);
  assert.deepEqual(page.problems, []);
  await page.context().close();
}

async function phonesShowAll() {
  const phone = { viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
  const page = await opened(phone);
  await page.setInputFiles("#file", photo);
  await until(page, /objects? found/);
  const overflow = await page.evaluate(() => document.scrollingElement.scrollWidth - innerWidth);
  assert.ok(overflow <= 0, `${overflow} pixels too wide`);
  await page.screenshot({ path: "pictures/phone.png", fullPage: true });
  await page.tap("#corners-panel summary");
  assert.ok(await page.evaluate(() => document.scrollingElement.scrollWidth <= innerWidth));
  assert.deepEqual(page.problems, []);
  await page.context().close();
}

try {
  await photoIsMeasured();
  await photoIsDropped();
  await tokenIsAskedFor();
  await filmIsFollowed();
  await cornersCalibrate();
  await phonesShowAll();
  console.log("all of the page works");
} finally {
  await browser.close();
}
