// The data of the page so far, of bounded size: all of the recent data, a part of the older ones.

const RECENT = 1500;
const MOST = 5000;

export const T = 0, N = 1, E = 2, D = 3, YAW = 4, AGE = 5, LATE = 6, SLOTS = 7, SEQ = 8; // of a point
export const ID = 0, ZONE = 1, CM = 2, DELTA = 3, RANGE = 4; // of a slot

export class Store {
  constructor() {
    this.version = 0;
    this.run = "";
    this.state = null;
    this.events = [];
    this.points = new Map(); // by receiver
  }

  // Uses a document of /state.json. Returns false if it is of another run.
  take(state) {
    const same = !this.run || this.run === state.run;
    if (!same && !state.full) return false;
    if (state.full) this.points.clear();
    if (state.all_events) this.events = [];
    this.run = state.run;
    this.version = state.version;
    this.state = state;
    this.events.push(...state.events);
    this.events.splice(0, Math.max(0, this.events.length - 200));
    for (const receiver of state.receivers) {
      const key = `${receiver.vehicle}/${receiver.name}`;
      const points = this.points.get(key) ?? [];
      for (const point of receiver.points) points.push(point);
      this.points.set(key, points.length > MOST ? thinned(points) : points);
    }
    return true;
  }

  get keys() { return [...this.points.keys()]; }
}

// Every second one of those that are not recent.
function thinned(points) {
  const from = points.length - RECENT;
  return points.filter((_, i) => i >= from || i % 2 === 0);
}

// The colour of a transmitter, by its place in the order in which they are known.
const ids = new Map();
export function numberOf(id) {
  if (!ids.has(id)) ids.set(id, ids.size % 6);
  return ids.get(id);
}
export function colourOf(id) { return css(`--c${numberOf(id)}`); }

// A sign of a transmitter, in its colour.
export function signOf(id) {
  const sign = el("span", { class: "dot", "aria-hidden": "true" });
  if (id !== null) sign.style.background = colourOf(id);
  return sign;
}

let colours = new Map();
export function css(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colours.get(name);
}
export function forgetColours() { colours = new Map(); }

export function clock(seconds) {
  const s = Math.max(0, Math.floor(seconds)), h = Math.floor(s / 3600);
  const two = (n) => String(n).padStart(2, "0");
  return h ? `${h}:${two(Math.floor(s / 60) % 60)}:${two(s % 60)}` : `${Math.floor(s / 60)}:${two(s % 60)}`;
}

// A number with `digits` behind the point, with a real minus sign, and no minus before a zero.
export function fixed(number, digits = 1) {
  const text = Math.abs(number).toFixed(digits);
  return number < 0 && Number(text) ? `−${text}` : text;
}

const COMPASS = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
// A way on the ground, [north, east] in metres, as a distance and a direction.
export function away([n, e]) {
  const m = Math.hypot(n, e);
  return m < 0.5 ? "at" : `${m.toFixed(m < 10 ? 1 : 0)} m ${COMPASS[Math.round(Math.atan2(e, n) / (Math.PI / 4) + 8) % 8]} of`;
}

// An error or uncertainty with its unit, never as 0.0 m.
export function precise(m, digits) {
  if (m < 0.01) return "less than 1 cm";
  return m < 0.1 ? `${Math.round(100 * m)} cm` : `${m.toFixed(digits)} m`;
}

// An element with attributes and children; texts are never markup.
export function el(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}
