// The data of the page, of bounded size: all recent readings, and a part of the older ones.

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

  // Use a document of /state.json. Return false if it is of another run.
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

// Return the points without every second one of the old ones.
function thinned(points) {
  const from = points.length - RECENT;
  return points.filter((_, i) => i >= from || i % 2 === 0);
}

// Colour and shape of a transmitter follow its id, here and in every picture: 6 colours and 7 shapes, so that 42 ids in a row differ.
const COLOURS = 6;
const SHAPES = ["M7 0A7 7 0 1 1-7 0A7 7 0 1 1 7 0Z", "M-6-6H6V6H-6Z", "M0-7.5L7 6H-7Z", "M0-8L8 0 0 8-8 0Z", "M0 7.5L7-6H-7Z", "M0-7.5L7.1-2.3 4.4 6.1-4.4 6.1-7.1-2.3Z", "M7.5 0L3.75 6.5-3.75 6.5-7.5 0-3.75-6.5 3.75-6.5Z"];
export function colourOf(id) { return css(id === null || id < 0 ? "--soft" : `--c${id % COLOURS}`); }
export function shapeOf(id) { return SHAPES[id === null || id < 0 ? 0 : id % SHAPES.length]; }

// Return the sign of a transmitter for a line of text.
export function signOf(id) {
  const look = id === null || id < 0 ? "" : `look${id % COLOURS}`;
  return svg("svg", { class: `dot ${look}`, viewBox: "-8 -8 16 16", "aria-hidden": "true" }, svg("path", { d: shapeOf(id) }));
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

// Return a number with `digits` decimal places, a real minus sign, and no minus before a zero.
export function fixed(number, digits = 1) {
  const text = Math.abs(number).toFixed(digits);
  return number < 0 && Number(text) ? `−${text}` : text;
}

// Return a place as two distances with directions, without a minus.
export function placed([n, e], digits = 1, [north, south, east, west] = [" m N", " m S", " m E", " m W"]) {
  const one = (m, forth, back) => `${Math.abs(m).toFixed(digits)}${m < 0 && Number(m.toFixed(digits)) ? back : forth}`;
  return `${one(n, north, south)}, ${one(e, east, west)}`;
}
export const DOUBT = "the readings contradict the place, or ± relative to the drone is above 0.4 m"; // of a place that is not sure
export const IN_WORDS = [" m north", " m south", " m east", " m west"];

const COMPASS = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
// Return a displacement, [north, east] in metres, as a distance and a direction.
export function away([n, e]) {
  const m = Math.hypot(n, e);
  return m < 0.5 ? "at" : `${m.toFixed(m < 10 ? 1 : 0)} m ${COMPASS[Math.round(Math.atan2(e, n) / (Math.PI / 4) + 8) % 8]} of`;
}

// Return an error or uncertainty with its unit, never as 0.0 m.
export function precise(m, digits) {
  if (m < 0.01) return "less than 1 cm";
  return m < 0.1 ? `${Math.round(100 * m)} cm` : `${m.toFixed(digits)} m`;
}

// Return milliseconds with their unit.
export function inTime(ms) { return ms < 1000 ? `${Math.round(ms)} ms` : `${(ms / 1000).toFixed(1)} s`; }

// Return an element with attributes and children; texts are never markup.
export function el(name, attributes, ...children) { return filled(document.createElement(name), attributes, children); }
export function svg(name, attributes, ...children) { return filled(document.createElementNS("http://www.w3.org/2000/svg", name), attributes, children); }

function filled(made, attributes, children) {
  for (const [key, value] of Object.entries(attributes ?? {})) made.setAttribute(key, value);
  made.append(...children);
  return made;
}
