// A lesson: the true places are hidden, a trainee marks victims with M, and the end has the score.

import { N, E, T } from "./store.js";

const GOOD_M = 2; // largest distance of a good mark from a transmitter
const key = (state) => `marks of ${state.run}`;
const marks = (state) => JSON.parse(sessionStorage.getItem(key(state)) ?? "[]"); // [time, north, east]; they survive a reload

export function mark(state, point) {
  if (!state.ended && point && point[N] !== null) sessionStorage.setItem(key(state), JSON.stringify([...marks(state), [point[T], point[N], point[E]]]));
}

// Return the marks as a search. At the end each mark gets the nearest transmitter without a mark.
export function lesson(state) {
  const free = [...state.transmitters], far = [];
  const victims = marks(state).map(([took_s, n, e]) => {
    const off = ({ place }) => Math.hypot(place[0] - n, place[1] - e), best = free.sort((a, b) => off(a) - off(b)).at(0);
    const sure = !state.ended || (best !== undefined && off(best) <= GOOD_M);
    if (best) far.push(off(best));
    free.shift();
    return { id: best?.id ?? null, place: [n, e], lat_lon: null, took_s, sure, marked: true, left: null };
  });
  const mean = far.length ? `mean error ${(far.reduce((a, b) => a + b) / far.length).toFixed(1)} m, ${victims.at(-1).took_s.toFixed(0)} s` : "no mark";
  return {
    vehicle: "", phase: state.ended ? "ended" : "lesson", ended: state.ended && mean, begun: true, wanted: state.transmitters.length || null, heard: [], target: null,
    take_off: [0, 0], victims, hypotheses: [], mean: null, covariance: null, goal: null, found: null, area: null, strip_m: null, left_s: null,
    doubt: `more than ${GOOD_M} m from the next transmitter`,
  };
}
