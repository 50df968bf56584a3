// What is wrong stands out: each check has a level, and the worst one is in the header.

import { AGE, LATE, N, clock, el, placed, precise } from "./store.js";

const ORDER = ["good", "warn", "bad"];
const LEVELS = { info: "info", warning: "warn", error: "bad" };
const SHORT = { GLOBAL_POSITION_INT: "position", ATTITUDE: "attitude" };
const QUIET = new Set(["bytes_received", "packets_received", "packets_ignored"]);
const LATE_MS = 50; // as the emulator
const $ = (id) => document.getElementById(id);
let shownEvents = "";

function readingChecks(state, every, stale) {
  const rows = [], point = every.at(-1);
  if (point) {
    const age = point[AGE];
    if (point[N] === null) rows.push([state.kind === "search" ? "good" : "bad", "pose", state.kind === "search" ? "on the ground" : "none", state.kind === "search" ? "" : "frames say no signal"]);
    else rows.push([age > 1000 ? "warn" : "good", "pose", age === null ? "there" : `${Math.round(age)} ms old`, age > 1000 ? "raise the rate of the autopilot's position, or use a faster link" : ""]);
  } else rows.push(["warn", "reading", "none yet"]);
  if (stale) rows.push(["bad", "reading", "no new one", "does the autopilot still send its position? See its streams and links"]);
  const late = Math.max(0, ...every.slice(-10).map((one) => one[LATE] ?? 0));
  if (late > LATE_MS) rows.push(["warn", "frames late", `up to ${late.toFixed(0)} ms`, "this computer has more to do than it can: end other programs, or lower --rate"]);
  return rows;
}

// Rows of [level, name, value, why]; those of the reading stand below its vehicle.
export function checks(state, every, stale, name) {
  const rows = [];
  const own = name?.split("/")[0];
  for (const vehicle of state.vehicles) {
    const label = state.vehicles.length > 1 ? vehicle.name : "vehicle";
    if (vehicle.silent) rows.push(["bad", label, "no heartbeat", `${vehicle.label}: is it powered, and in range of its link?`]);
    else rows.push([vehicle.label ? "good" : "bad", label, vehicle.label || "not found yet"]);
    const many = state.vehicles.length > 1;
    for (const [level, what, value, cure] of vehicle.checks) {
      if (vehicle.name === own || !many || level !== "good") rows.push([level, many ? `${vehicle.name}: ${what}` : what, value, cure]);
    }
    if (vehicle.name !== own && many) continue;
    for (const stream of vehicle.streams) {
      const asked = stream.asked_hz, slow = asked ? stream.hz < 0.5 * asked : stream.hz < 2;
      rows.push([slow ? "warn" : "good", SHORT[stream.name] ?? stream.name.toLowerCase(), `${stream.hz.toFixed(0)} Hz${asked ? ` of ${asked.toFixed(0)}` : ""}`, slow ? "the link is too slow, or another program sets the rate: arva-hil doctor" : ""]);
    }
    for (const receiver of vehicle.receivers) {
      rows.push([receiver.dropped ? "warn" : "good", state.receivers.length > 1 ? `frames of ${receiver.name}` : "frames", String(receiver.frames - receiver.dropped), receiver.dropped ? `${receiver.dropped} dropped: nobody read them` : ""]);
    }
    if (vehicle.name === own) rows.push(...readingChecks(state, every, stale));
  }
  if (!state.vehicles.some((vehicle) => vehicle.name === own)) rows.push(...readingChecks(state, every, stale));
  for (const link of state.links) {
    const lost = link.losses ? `lost ${link.losses} ×` : "";
    rows.push([link.open ? (link.losses ? "warn" : "good") : "bad", link.name, link.open ? lost || "open" : "lost", link.open ? "" : link.why]);
  }
  const met = new Set(state.receivers.flatMap((receiver) => receiver.faults));
  if (met.size) rows.push(["warn", "faults on", [...met].join(", ")]);
  else if (state.planned_faults.length) rows.push(["good", "faults", `${state.planned_faults.length} planned`, state.planned_faults.join("; ")]);
  return rows;
}

export function showChecks(rows, connected) {
  $("checks").replaceChildren(...rows.map(([level, name, value, why]) => el("li", { "data-level": level },
    el("span", { class: "sign", "aria-hidden": "true" }), el("span", {}, name), el("span", { class: "value" }, value),
    ...(why ? [el("span", { class: "why" }, why)] : []))));
  const wrong = rows.filter(([level]) => level !== "good");
  const worst = wrong.reduce((level, row) => (ORDER.indexOf(row[0]) > ORDER.indexOf(level) ? row[0] : level), "good");
  const first = wrong.find(([level]) => level === worst);
  const words = !connected ? "no connection" : !first ? "all well" : `${first[1]}: ${first[2]}${wrong.length > 1 ? ` (+${wrong.length - 1})` : ""}`;
  $("pill").dataset.level = connected ? worst : "bad";
  if ($("pill-text").textContent !== words) $("pill-text").textContent = words;
}

export function showCounters(state) {
  const every = state.vehicles.flatMap((vehicle) => Object.entries(vehicle.counters).map(([name, count]) => [state.vehicles.length > 1 ? `${vehicle.name}: ${name}` : name, count, name]));
  const rows = every.filter(([, count, name]) => count || QUIET.has(name));
  $("counters").replaceChildren(...rows.flatMap(([name, count]) => [el("dt", {}, name.replaceAll("_", " ")), el("dd", {}, String(count))]));
}

// The time of an event; in a record a button that shows it.
function timeOf(time, go) {
  if (!go) return el("time", {}, clock(time));
  const button = el("button", { type: "button", class: "when", title: "Show this time" }, clock(time));
  button.addEventListener("click", () => go(time));
  return button;
}

export function showEvents(events, go) {
  const key = `${events.length} ${events.at(-1)?.join() ?? ""}`;
  if (key === shownEvents) return;
  shownEvents = key;
  $("events").replaceChildren(...events.toReversed().map(([time, level, words]) => el("li", { "data-level": LEVELS[level] ?? "info" },
    timeOf(time, go), el("span", { class: "sign", "aria-hidden": "true" }), el("span", {}, words))));
}


// The standard deviations along the axes of an ellipse, m, and the direction of the first, radians from north.
export function axes([nn, ne, ee]) {
  const middle = (nn + ee) / 2, half = Math.hypot((nn - ee) / 2, ne);
  return { a: Math.sqrt(Math.max(0, middle + half)), b: Math.sqrt(Math.max(0, middle - half)), angle: Math.atan2(2 * ne, nn - ee) / 2 };
}

// Places are from the take-off point; those of a team, which has many, are from the datum, as in the team's table.
// `share`: of the area that is searched, %.
export function showSearch(search, truth, transmitters, team, share) {
  $("search").hidden = !search;
  if (!search) return;
  const from = (p) => (team.length ? p : [p[0] - search.take_off[0], p[1] - search.take_off[1]]);
  $("phase").textContent = search.phase;
  const rows = [["target", search.target === null ? (search.heard.length && search.phase !== "searching" ? "without a number" : "none yet") : `transmitter ${search.target}`]];
  if (search.found) {
    rows.push(["place found", placed(from(search.found.place))]);
    rows.push(["sure", search.found.sure ? "yes" : "no: readings do not agree"]);
  } else if (search.mean) {
    rows.push(["estimate", placed(from(search.mean))], ["hypotheses", String(search.hypotheses.length)]);
  }
  const relative = search.found ? search.found.relative_covariance ?? search.found.covariance : search.covariance;
  if (relative) rows.push(["from the drone", `± ${precise(axes(relative).a, 1)}`]);
  if (search.found?.earth_covariance) rows.push(["on Earth", `± ${precise(axes(search.found.earth_covariance).a, 1)}`]);
  const believed = search.found?.place ?? search.mean, id = search.found?.id ?? search.target;
  const real = transmitters.find((one) => one.id === id) ?? (transmitters.length === 1 ? transmitters[0] : null);
  if (truth && believed && real) rows.push(["off the truth", precise(Math.hypot(believed[0] - real.place[0], believed[1] - real.place[1]), 2)]);
  if (share !== null) rows.push(["area searched", `${share.toFixed(0)} %`]);
  if (search.left_s !== null) rows.push(["time left", clock(search.left_s)]);
  if (search.ended) rows.push(["ended", search.ended]);
  $("belief").replaceChildren(...rows.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]));
}

// A row for each search of several: its vehicle, what it does, where it is, which transmitter it flies to or has found.
export function showTeam(team, points, chosen, choose) {
  $("team").hidden = !team.length;
  if (team.length) $("search").hidden = false;
  const near = (at) => placed(at, 0, [" N", " S", " E", " W"]);
  const held = document.activeElement?.dataset.key;
  $("team-rows").replaceChildren(...team.map((one) => {
    const key = [...points.keys()].find((each) => each.slice(0, each.lastIndexOf("/")) === one.vehicle);
    const last = points.get(key)?.findLast((point) => point[N] !== null), id = one.found?.id ?? one.target;
    const number = id === null ? "" : String(id), found = one.found ? `${number} ${one.found.sure ? "found" : "not sure"}` : number;
    const name = el("span", key ? { role: "button", tabindex: "0", "data-key": key } : {}, one.vehicle);
    name.addEventListener("click", () => choose(key));
    name.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(key); });
    return el("tr", key === chosen ? { "aria-current": "true" } : {}, el("th", { scope: "row" }, name),
      el("td", {}, one.phase), el("td", {}, last ? near([last[N], last[N + 1]]) : ""), el("td", {}, found));
  }));
  if (held) [...$("team-rows").querySelectorAll("[data-key]")].find((one) => one.dataset.key === held)?.focus();
}
