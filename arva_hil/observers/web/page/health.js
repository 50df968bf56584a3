// Checks with a level and a cure; the worst one is in the header. The state of a search.

import { AGE, DOUBT, LATE, N, clock, el, inTime, placed, precise } from "./store.js";

const ORDER = ["good", "warn", "bad"];
const LEVELS = { info: "info", warning: "warn", error: "bad" };
const SHORT = { GLOBAL_POSITION_INT: "position", ATTITUDE: "attitude" };
const QUIET = new Set(["bytes_received", "packets_received", "packets_ignored"]);
const LATE_MS = 50; // the emulator warns at the same value
const $ = (id) => document.getElementById(id);
let shownEvents = "";

const notFound = (label) => ["bad", label, "not found yet", "is it powered, and the address of its link right? See arva-hil doctor"];

// Rows of [level, name, value, cure] for the newest readings.
function readingChecks(state, every, stale) {
  const point = every.at(-1), rows = [];
  if (!point) return [["warn", "reading", "none yet", state.kind === "search" ? "is the receiver on, and the address of its link right?" : ""]];
  const age = point[AGE], late = Math.max(...every.slice(-10).map((one) => one[LATE] ?? 0));
  if (point[N] !== null) rows.push([age > 1000 ? "warn" : "good", "pose", age === null ? "known" : `${inTime(age)} old`, age > 1000 ? "raise the rate of the autopilot's position, or use a faster link" : ""]);
  else if (state.kind === "search") rows.push(["good", "pose", "on the ground"]);
  else rows.push(["bad", "pose", "none", "until the autopilot sends its position, frames have no signal"]);
  if (stale) rows.push(["bad", "reading", "no new one", "does the autopilot still send its position? See its streams and links"]);
  if (late > LATE_MS) rows.push(["warn", "frames late", `up to ${inTime(late)}`, "this computer is overloaded: end other programs, or lower --rate"]);
  return rows;
}

// Rows of [level, name, value, cure] for vehicles, links and faults. The chosen vehicle has all its rows, another one
// only its faulty ones.
export function checks(state, every, stale, receiver) {
  const many = state.vehicles.length > 1, own = receiver?.split("/")[0];
  const rows = state.vehicles.flatMap((vehicle) => vehicleChecks(vehicle, many, vehicle.name === own || !many, state.receivers.length > 1));
  if (!state.vehicles.length && state.kind !== "view") rows.push(notFound("vehicle"));
  rows.push(...readingChecks(state, every, stale));
  for (const link of state.links) {
    const lost = link.losses ? `lost ${link.losses} ×` : "";
    rows.push(link.open ? [lost ? "warn" : "good", link.name, lost || "open"] : ["bad", link.name, "lost", link.why]);
  }
  const met = new Set(state.receivers.flatMap((one) => one.faults));
  if (met.size) rows.push(["warn", "faults on", [...met].join(", ")]);
  else if (state.planned_faults.length) rows.push(["good", "faults", `${state.planned_faults.length} planned`, state.planned_faults.join("; ")]);
  return rows;
}

function vehicleChecks(vehicle, many, whole, named) {
  const label = many ? vehicle.name : "vehicle", rows = [];
  if (vehicle.silent) rows.push(["bad", label, "no heartbeat", `${vehicle.label}: is it powered, and in range of its link?`]);
  else rows.push(vehicle.label ? ["good", label, vehicle.label] : notFound(label));
  for (const [level, what, value, cure] of vehicle.checks) {
    if (whole || level !== "good") rows.push([level, many ? `${vehicle.name}: ${what}` : what, value, cure]);
  }
  if (!whole) return rows;
  for (const { name, hz, asked_hz: asked } of vehicle.silent ? [] : vehicle.streams) {
    const slow = asked ? hz < 0.5 * asked : hz < 2;
    rows.push([slow ? "warn" : "good", SHORT[name] ?? name.toLowerCase(), `${hz.toFixed(0)} Hz${asked ? ` of ${asked.toFixed(0)}` : ""}`, slow ? "the link is too slow, or another program sets the rate: arva-hil doctor" : ""]);
  }
  for (const { name, frames, dropped } of vehicle.receivers) {
    rows.push([dropped ? "warn" : "good", named ? `frames of ${name}` : "frames", String(frames - dropped), dropped ? `${dropped} dropped: no program reads them` : ""]);
  }
  return rows;
}

export function showChecks(rows, connected) {
  $("checks").replaceChildren(...rows.map(([level, name, value, why]) => el("li", { "data-level": level },
    el("span", { class: "sign", "aria-hidden": "true" }), el("span", {}, name), el("span", { class: "value" }, value),
    ...(why ? [el("span", { class: "why" }, why)] : []))));
  const wrong = rows.filter(([level]) => level !== "good");
  const worst = wrong.reduce((level, row) => (ORDER.indexOf(row[0]) > ORDER.indexOf(level) ? row[0] : level), "good");
  const first = wrong.find(([level]) => level === worst);
  let text = first ? `${first[1]}: ${first[2]}${wrong.length > 1 ? ` (+${wrong.length - 1})` : ""}` : "all well";
  if (!connected) text = "no connection";
  $("pill").dataset.level = connected ? worst : "bad";
  if ($("pill-text").textContent !== text) $("pill-text").textContent = text;
}

export function showCounters(state) {
  const every = state.vehicles.flatMap((vehicle) => Object.entries(vehicle.counters).map(([name, count]) => [state.vehicles.length > 1 ? `${vehicle.name}: ${name}` : name, count, name]));
  const rows = every.filter(([, count, name]) => count || QUIET.has(name));
  $("counters").replaceChildren(...rows.flatMap(([name, count]) => [el("dt", {}, name.replaceAll("_", " ")), el("dd", {}, String(count))]));
}

// Return the time of an event; in a record a button that goes there.
function timeOf(time, go) {
  if (!go) return el("time", {}, clock(time));
  const button = el("button", { type: "button", class: "when", title: "Go to this time", "data-at": time }, clock(time));
  button.addEventListener("click", () => go(time + 0.01)); // the time is rounded, perhaps down
  return button;
}

export function showEvents(events, go) {
  const key = `${events.length} ${events.at(-1)?.join() ?? ""}`;
  if (key === shownEvents) return;
  shownEvents = key;
  const held = document.activeElement?.dataset.at;
  $("events").replaceChildren(...events.toReversed().map(([time, level, text]) => el("li", { "data-level": LEVELS[level] ?? "info" },
    timeOf(time, go), el("span", { class: "sign", "aria-hidden": "true" }), el("span", {}, text))));
  if (held) $("events").querySelector(`[data-at="${held}"]`)?.focus();
}

// Return the standard deviations along the axes of an ellipse, m, and the direction of the first, radians from north.
export function axes([nn, ne, ee]) {
  const middle = (nn + ee) / 2, half = Math.hypot((nn - ee) / 2, ne);
  return { a: Math.sqrt(Math.max(0, middle + half)), b: Math.sqrt(Math.max(0, middle - half)), angle: Math.atan2(2 * ne, nn - ee) / 2 };
}

// Places are from the take-off point; those of a team are from the datum, because each drone has its own take-off point.
// `share`: searched part of the area, %.
export function showSearch(search, truth, transmitters, team, share) {
  $("search").hidden = !search;
  if (!search) return;
  const from = (p) => (team.length ? p : [p[0] - search.take_off[0], p[1] - search.take_off[1]]);
  $("phase").textContent = search.phase;
  const rows = search.target === null ? [] : [["target", `transmitter ${search.target}`]];
  if (search.found) {
    rows.push(["place found", placed(from(search.found.place))]);
    rows.push(["sure", search.found.sure ? "yes" : `no: ${DOUBT}`]);
  } else if (search.mean) {
    rows.push(["estimate", placed(from(search.mean))], ["hypotheses", String(search.hypotheses.length)]);
  }
  const relative = search.found ? search.found.relative_covariance ?? search.found.covariance : search.covariance;
  if (relative) rows.push(["from the drone", `± ${precise(axes(relative).a, 1)}`]);
  if (search.found?.earth_covariance) {
    const more = search.found.autopilot_sigma_m === null ? ", or more" : "";  // the autopilot does not report its accuracy
    rows.push(["on Earth", `± ${precise(axes(search.found.earth_covariance).a, 1)}${more}`]);
  }
  const believed = search.found?.place ?? search.mean, id = search.found?.id ?? search.target;
  const real = transmitters.find((one) => one.id === id) ?? (transmitters.length === 1 ? transmitters[0] : null);
  if (truth && believed && real) rows.push(["off the truth", precise(Math.hypot(believed[0] - real.place[0], believed[1] - real.place[1]), 2)]);
  if (share !== null) rows.push(["area searched", `${share.toFixed(0)} %`]);
  if (search.left_s !== null) rows.push(["time left", clock(search.left_s)]);
  if (search.ended) rows.push(["ended", search.ended]);
  $("belief").replaceChildren(...rows.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]));
}

// A row for each search: its vehicle, its state, its place, and the transmitter that is its target or found.
export function showTeam(team, points, chosen, choose) {
  $("team").hidden = !team.length;
  if (team.length) $("search").hidden = false;
  const near = (at) => placed(at, 0, [" N", " S", " E", " W"]);
  const held = document.activeElement?.dataset.key;
  $("team-rows").replaceChildren(...team.map((one) => {
    const key = [...points.keys()].find((each) => each.slice(0, each.lastIndexOf("/")) === one.vehicle);
    const last = points.get(key)?.findLast((point) => point[N] !== null), id = one.found?.id ?? one.target;
    const number = id === null ? "" : String(id), found = one.found ? `${number} ${one.found.sure ? "found" : "not sure"}` : number;
    const name = el("button", { type: "button", class: "link", "data-key": key ?? "" }, one.vehicle);
    name.disabled = !key;
    name.addEventListener("click", () => choose(key));
    return el("tr", key === chosen ? { "aria-current": "true" } : {}, el("th", { scope: "row" }, name),
      el("td", {}, one.phase), el("td", {}, last ? near([last[N], last[N + 1]]) : ""), el("td", {}, found));
  }));
  if (held) [...$("team-rows").querySelectorAll("[data-key]")].find((one) => one.dataset.key === held)?.focus();
}
