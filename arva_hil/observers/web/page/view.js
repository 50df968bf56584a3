// The visible part of the ground, in metres, north up: drag, wheel, pinch and keys.

export class View {
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.changed = changed;
    this.north = 0;
    this.east = 0;
    this.scale = 8; // pixels a metre
    this.mode = "fit"; // fit, follow or free
    this.onMode = () => {};
    this.pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-Math.max(-300, Math.min(300, event.deltaY)) * 0.0016), event.offsetX, event.offsetY);
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  get width() { return this.canvas.clientWidth; }
  get height() { return this.canvas.clientHeight; }
  x(east) { return this.width / 2 + (east - this.east) * this.scale; }
  y(north) { return this.height / 2 - (north - this.north) * this.scale; }

  set(mode) {
    if (mode === this.mode) return;
    this.mode = mode;
    this.onMode(mode);
    this.changed();
  }

  zoom(by, x = this.width / 2, y = this.height / 2) {
    const scale = Math.max(0.02, Math.min(400, this.scale * by));
    if (this.mode !== "follow") {
      this.east += (x - this.width / 2) * (1 / this.scale - 1 / scale);
      this.north -= (y - this.height / 2) * (1 / this.scale - 1 / scale);
      this.set("free");
    }
    this.scale = scale;
    this.changed();
  }

  pan(dx, dy) {
    this.east -= dx / this.scale;
    this.north += dy / this.scale;
    this.set("free");
    this.changed();
  }

  // Fit a box [south, west, north, east] with a margin, right of `left` covered pixels.
  frame(box, left) {
    const [south, west, north, east] = box, margin = Math.min(70, this.width * 0.12, this.height * 0.25);
    this.north = (south + north) / 2;
    const across = Math.max(6, east - west), along = Math.max(6, north - south);
    this.scale = Math.min((this.width - left - 2 * margin) / across, (this.height - 2 * margin) / along, 60);
    this.east = (west + east - left / this.scale) / 2;
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY], other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, now);
    if (!other) return this.pan(now[0] - before[0], now[1] - before[1]);
    const length = (p) => Math.max(10, Math.hypot(p[0] - other[0], p[1] - other[1]));
    this.zoom(length(now) / length(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    if (this.mode === "free") this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
  }

  key(event) {
    const steps = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (steps[event.key]) this.pan(...steps[event.key]);
    else if (event.key === "+" || event.key === "=") this.zoom(1.3);
    else if (event.key === "-") this.zoom(1 / 1.3);
    else if (event.key === "0") this.set("fit");
    else if (event.key === "f" || event.key === "F") this.set("follow");
    else return;
    event.preventDefault();
  }
}
