// The player of a record: the chosen time, and the time line with phases, faults, events and marks.

import { clock, el } from "./store.js";

const $ = (id) => document.getElementById(id);

const line = $("line");
let shown = "";

// Return the position of a time in a window of time, as a length.
const at = (time, [from, to]) => `${(100 * (time - from)) / Math.max(1e-3, to - from)}%`;

function showTimeLine(data, window, time, vehicle) {
  const key = JSON.stringify([window, vehicle, data.events.length]);
  if (key !== shown) {
    shown = key;
    const inside = (from, to = from) => to >= window[0] && from <= window[1];
    const made = [];
    const put = (from, to, attributes, text = "") => {
      const one = el("span", attributes, text);
      one.style.left = at(Math.max(from, window[0]), window);
      if (to > from) one.style.width = `calc(${at(Math.min(to, window[1]), window)} - ${one.style.left})`;
      made.push(one);
    };
    for (const kind of ["phases", "faults", "marks"]) {
      for (const [from, to, of, text] of data[kind]) {
        if (inside(from, to) && (of === vehicle || !of)) put(from, to, { class: kind, title: `${text}, ${clock(from)}` }, kind === "marks" ? "" : text);
      }
    }
    for (const [when, level, text] of data.events) {
      if (inside(when)) put(when, when, { class: "tick", "data-level": level, title: `${clock(when)} ${text}` });
    }
    line.replaceChildren(...made, el("span", { class: "now" }));
  }
  line.lastChild.style.left = at(time, window);
}

export class Player {
  constructor(changed) {
    this.changed = changed;
    this.span = null;
    const wanted = Number.parseFloat(new URLSearchParams(location.hash.slice(1)).get("t"));
    this.at = Number.isFinite(wanted) ? wanted : null; // from the address
    this.asked = null;
    this.playing = false;
    this.before = 0;
    this.window = null; // the times at the ends of slider and line
    this.line = { phases: [], faults: [], marks: [], events: [] };
    this.vehicle = "";
    $("longer").addEventListener("click", () => this.zoom(2));
    $("shorter").addEventListener("click", () => this.zoom(0.5));
    line.addEventListener("wheel", (event) => { event.preventDefault(); this.zoom(event.deltaY > 0 ? 1.25 : 0.8); }, { passive: false });
    line.addEventListener("pointerdown", (event) => { line.setPointerCapture(event.pointerId); this.point(event); });
    line.addEventListener("pointermove", (event) => { if (event.buttons) this.point(event); });
    $("slider").addEventListener("input", () => { this.at = Number($("slider").value); this.show(); this.changed(); });
    $("play").addEventListener("click", () => this.play(!this.playing));
  }

  // Forget the record: another run has its address.
  forget() {
    if (this.playing) this.play(false);
    this.span = null;
    shown = "";
    $("player").hidden = true;
  }

  // Go to a time, seconds.
  go(at) {
    if (!this.span) return;
    if (this.playing) this.play(false);
    this.at = Math.min(this.span[1], Math.max(this.span[0], at));
    this.show();
    this.changed();
  }

  // Go to the time at a pointer.
  point(event) {
    const { left, width } = line.getBoundingClientRect(), [from, to] = this.window;
    this.go(from + ((event.clientX - left) / width) * (to - from));
  }

  // Multiply the length of the window around the chosen time.
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

  // Return the part of a request with the time. A record opens at its end.
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

  // Return true if the chosen time is not the requested one.
  hurried() { return !this.playing && this.at !== this.asked; }
}
