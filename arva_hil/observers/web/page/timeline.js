// The time line of a record: phases, faults, events and marks above the slider.

import { clock, el } from "./store.js";

const line = document.getElementById("line");
let shown = "";

// Return the position of a time in a window of time, as a length.
const at = (time, [from, to]) => `${(100 * (time - from)) / Math.max(1e-3, to - from)}%`;

export function showTimeLine(data, window, time, vehicle) {
  const key = JSON.stringify([window, vehicle, data.events.length]);
  if (key !== shown) {
    shown = key;
    const inside = (from, to = from) => to >= window[0] && from <= window[1];
    const made = [];
    const put = (from, to, attributes, words = "") => {
      const one = el("span", attributes, words);
      one.style.left = at(Math.max(from, window[0]), window);
      if (to > from) one.style.width = `calc(${at(Math.min(to, window[1]), window)} - ${one.style.left})`;
      made.push(one);
    };
    for (const kind of ["phases", "faults", "marks"]) {
      for (const [from, to, of, words] of data[kind]) {
        if (inside(from, to) && (of === vehicle || !of)) put(from, to, { class: kind, title: `${words}, ${clock(from)}` }, kind === "marks" ? "" : words);
      }
    }
    for (const [when, level, words] of data.events) {
      if (inside(when)) put(when, when, { class: "tick", "data-level": level, title: `${clock(when)} ${words}` });
    }
    line.replaceChildren(...made, el("span", { class: "now" }));
  }
  line.lastChild.style.left = at(time, window);
}
