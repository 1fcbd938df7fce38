// Marking the four corners of a rectangle on the road, by mouse, finger or keyboard.

const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
/** A click as near as this to a corner takes it along instead of adding one, pixels of the page. */
const NEAR_PX = 14;

/** Corners in pixels of the image. `changed` is called when they, or the cursor, are others. */
export class Corners {
  constructor(canvas, imageSize, changed) {
    Object.assign(this, { canvas, imageSize, changed, points: [], cursor: null, isOn: false, held: -1 });
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", () => this.release());
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("blur", () => this.showCursor(null));
  }

  /** Whether clicks mark corners. */
  turn(isOn) {
    this.isOn = isOn;
    this.canvas.classList.toggle("marking", isOn);
    if (isOn) this.canvas.tabIndex = 0;
    else this.canvas.removeAttribute("tabindex");
    this.showCursor(null);
  }

  clear() {
    this.points = [];
    this.changed();
  }

  /** Pixels of the image in one of the page. */
  unit() {
    return this.imageSize().width / Math.max(this.canvas.clientWidth, 1);
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * this.unit(), (event.clientY - box.top) * this.unit()];
  }

  press(event) {
    if (!this.isOn || !this.imageSize()) return;
    const point = this.at(event);
    const near = NEAR_PX * this.unit();
    this.held = this.points.findIndex(([x, y]) => Math.hypot(x - point[0], y - point[1]) < near);
    if (this.held < 0 && this.points.length < 4) this.held = this.points.push(point) - 1;
    if (this.held >= 0) this.canvas.setPointerCapture(event.pointerId);
    this.changed();
  }

  move(event) {
    if (this.held < 0) return;
    this.points[this.held] = this.at(event);
    this.changed();
  }

  release() {
    this.held = -1;
  }

  key(event) {
    if (!this.isOn || !this.imageSize()) return;
    const { width, height } = this.imageSize();
    const [x, y] = this.cursor ?? [width / 2, height * 0.7];
    const step = STEPS[event.key];
    if (step) {
      const size = this.unit() * (event.shiftKey ? 20 : 2);
      const inside = (value, most) => Math.max(0, Math.min(most, value));
      this.showCursor([inside(x + step[0] * size, width), inside(y + step[1] * size, height)]);
    } else if (event.key === "Enter" && this.points.length < 4) {
      this.points.push([x, y]);
      this.showCursor([x, y]);
    } else if (event.key === "Backspace") {
      this.points.pop();
      this.changed();
    } else {
      return;
    }
    event.preventDefault();
  }

  showCursor(cursor) {
    this.cursor = cursor;
    this.changed();
  }
}
