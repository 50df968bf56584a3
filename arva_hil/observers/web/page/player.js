// The player of a record: the chosen time, and playing from there.

import { clock } from "./store.js";
import { showTimeLine } from "./timeline.js";

const $ = (id) => document.getElementById(id);

export class Player {
  constructor(changed) {
    this.changed = changed;
    this.span = null;
    const wanted = Number.parseFloat(new URLSearchParams(location.hash.slice(1)).get("t"));
    this.at = Number.isFinite(wanted) ? wanted : null; // of a link
    this.asked = null;
    this.playing = false;
    this.before = 0;
    this.window = null; // of time that the slider and the line show
    this.line = { phases: [], faults: [], marks: [], events: [] };
    this.vehicle = "";
    $("longer").addEventListener("click", () => this.zoom(2));
    $("shorter").addEventListener("click", () => this.zoom(0.5));
    $("line").addEventListener("wheel", (event) => { event.preventDefault(); this.zoom(event.deltaY > 0 ? 1.25 : 0.8); }, { passive: false });
    $("line").addEventListener("pointerdown", (event) => { $("line").setPointerCapture(event.pointerId); this.point(event); });
    $("line").addEventListener("pointermove", (event) => { if (event.buttons) this.point(event); });
    $("slider").addEventListener("input", () => { this.at = Number($("slider").value); this.show(); this.changed(); });
    $("play").addEventListener("click", () => this.play(!this.playing));
  }

  // Shows another time, seconds.
  go(at) {
    if (!this.span) return;
    if (this.playing) this.play(false);
    this.at = Math.min(this.span[1], Math.max(this.span[0], at));
    this.show();
    this.changed();
  }

  // Goes to the time under a pointer.
  point(event) {
    const { left, width } = $("line").getBoundingClientRect(), [from, to] = this.window;
    this.go(from + ((event.clientX - left) / width) * (to - from));
  }

  // Shows so many times as much time around the chosen one.
  zoom(by) {
    const [first, end] = this.span, length = Math.min(end - first, Math.max(2, by * (this.window[1] - this.window[0])));
    const from = Math.min(end - length, Math.max(first, this.at - length / 2));
    this.window = [from, from + length];
    this.show();
  }

  play(on) {
    if (on && this.at >= this.span[1]) this.at = this.span[0];
    this.playing = on;
    this.before = performance.now();
    $("play").setAttribute("aria-pressed", on);
    $("play").textContent = on ? "Pause" : "Play";
    this.changed();
  }

  // The part of a request that says which time; a record begins with its end, so that all of it is seen.
  query() {
    if (this.playing) {
      const now = performance.now();
      this.at = Math.min(this.span[1], this.at + ((now - this.before) / 1000) * Number($("speed").value));
      this.before = now;
      if (this.at >= this.span[1]) this.play(false);
    }
    this.asked = this.at;
    return `&at=${this.at ?? "end"}`;
  }

  take(state) {
    if (!state.span) return;
    const first = this.span === null;
    this.span = state.span;
    if (first) {
      $("player").hidden = false;
      this.window = state.span;
      this.at = this.asked = state.at;
    }
    this.show();
  }

  show() {
    if (this.at < this.window[0] || this.at > this.window[1]) this.zoom(1);
    [$("slider").min, $("slider").max] = this.window;
    showTimeLine(this.line, this.window, this.at, this.vehicle);
    $("slider").value = this.at;
    $("slider").setAttribute("aria-valuetext", clock(this.at));
    $("at").textContent = `${clock(this.at)} of ${clock(this.span[1])}`;
  }

  // Whether another time is wanted than the one that was asked for.
  hurried() { return !this.playing && this.at !== this.asked; }
}
