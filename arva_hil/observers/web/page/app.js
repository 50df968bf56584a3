// Requests the changes a few times a second, and updates the parts of the page.

import { checks, showChecks, showCounters, showEvents, showSearch, showTeam } from "./health.js";
import { setTone, showDisplay, updateTone } from "./display.js";
import { outcomeOf, showOutcome, showVictims } from "./outcome.js";
import { searched, showMap, vehicleAt, view } from "./map.js";
import { forgetPlots, setSpan, showPlots } from "./plots.js";
import { lesson, mark } from "./lesson.js";
import { Player } from "./player.js";
import { E, IN_WORDS, N, Store, T, YAW, away, clock, el, forgetColours, placed, svg } from "./store.js";

const POLL_MS = 200, HIDDEN_MS = 2000, RETRY_MS = 1000, ENDED_MS = 3000, PLOT_MS = 500;
const $ = (id) => document.getElementById(id);
const store = new Store(), player = new Player(() => poll());
let field = { version: -1, transmitters: [] }, fieldAsked = 0, failures = 0, plotted = 0;
let chosen = new URLSearchParams(location.hash.slice(1)).get("r") ?? "", truth = true, newest = null, newestAt = 0, legend = "";

async function ask(name) {
  if (globalThis.offline) return globalThis.offline(name);
  const answer = await fetch(name, { cache: "no-store", signal: AbortSignal.timeout(4000) });
  if (!answer.ok) throw new Error(String(answer.status));
  return answer.json();
}

let timer = 0, asking = false;

async function poll() {
  clearTimeout(timer);
  if (asking) return;
  asking = true;
  let pause = document.hidden ? HIDDEN_MS : POLL_MS;
  try {
    const before = store.version, run = store.run, state = await ask(`state.json?since=${before}${player.query()}`);
    failures = 0;
    const taken = store.take(state);
    if (store.run !== run) forgetRun();
    player.vehicle = chosen.slice(0, chosen.lastIndexOf("/"));
    if (state.span && !player.span) player.line = await ask("timeline.json");
    player.take(state); // before the events, which are buttons if there is a player
    if (!taken) store.version = 0;
    else if (state.version !== before || !plotted) show();
    if (state.field !== field.version && state.field !== fieldAsked) {
      fieldAsked = state.field;
      field = await ask("field.json");
      show();
    }
    if (stale() || !plotted) show();
    if (state.ended) pause = ENDED_MS; // the next run may have the same address
    document.documentElement.dataset.ready = "true";
  } catch {
    failures += 1;
    fieldAsked = 0;
    pause = RETRY_MS;
    if (store.state?.ended) pause = ENDED_MS;
    else if (failures === 2) { store.version = 0; show(); }
  }
  asking = false;
  timer = setTimeout(poll, player.hurried() ? 0 : pause);
}

// Forget what belongs to the run before at this address.
function forgetRun() {
  field = { version: -1, transmitters: [] };
  fieldAsked = 0;
  player.forget();
}

const points = () => store.points.get(chosen) ?? [];

// Return the time between readings, seconds, from the last few.
function period(every) {
  const last = every.slice(-6);
  return last.length < 2 ? 1 : (last.at(-1)[T] - last[0][T]) / (last.length - 1);
}

function stale() {
  if (!newest || store.state?.ended) return false;
  return store.state.kind !== "view" && performance.now() - newestAt > Math.max(3000, 3000 * period(points()));
}

function show() {
  const state = store.state;
  if (!state) { showBanner(); return; }
  if (!store.points.has(chosen)) chosen = store.keys[0] ?? "";
  const every = points(), last = every.at(-1);
  if (state.lesson && !state.search) state.search = lesson(state);
  $("mark").hidden = !state.lesson || Boolean(state.ended);
  if (last !== newest) { newest = last; newestAt = performance.now(); }
  const old = !state.ended && (Boolean(stale()) || failures >= 2);
  const shown = truth && state.known;
  document.body.classList.toggle("no-truth", !shown);
  $("truth").hidden = !state.known;
  $("kind").textContent = state.kind;
  $("title").textContent = state.title;
  document.title = `${state.kind} · arva-hil`;
  $("clock").textContent = clock(last ? last[T] : state.time_s);
  $("device-name").textContent = store.keys.length > 1 ? chosen : "";
  showChoice();
  showDisplay(last, old, state.receivers.find((one) => `${one.vehicle}/${one.name}` === chosen)?.frames);
  updateTone(last, old || Boolean(state.ended));
  showChecks(checks(state, every, !state.ended && !failures && old, chosen), failures < 2 || state.ended);
  showCounters(state);
  showEvents(store.events, player.span ? (time) => player.go(time) : null);
  showLink(state);
  const search = mine(state);
  showSearch(search, shown, own(state.transmitters), state.team, search && searched(search, vehicles()));
  const there = state.team.length ? state.transmitters : own(state.transmitters), outcome = outcomeOf(state, shown ? there : []);
  showOutcome(outcome);
  showVictims(search, outcome, last);
  showTeam(state.team, store.points, chosen, choose);
  showMap({
    truth: shown, all: state.transmitters, transmitters: own(state.transmitters), field: field.transmitters, search, chosen, background: state.background, run: state.run,
    vehicles: vehicles(), team: state.team.filter((one) => one !== search),
  });
  $("map").setAttribute("aria-label", describe(state, last, shown));
  showLegend(state, shown);
  showBanner();
  if (state.kind === "view") plotted = Math.min(plotted, performance.now() - PLOT_MS / 2);
  if (performance.now() - plotted > PLOT_MS || state.ended) { plotted = performance.now(); showPlots(every, shown, own(state.transmitters).length === 1); }
}

// Return each vehicle with its chosen receiver, or its first. `ghost`: its last place if it is lost, else null.
function vehicles() {
  const found = new Map(), state = store.state;
  for (const [key, every] of store.points) {
    const name = key.slice(0, key.lastIndexOf("/"));
    if (!found.has(name) || key === chosen) found.set(name, { key, name, points: every, period: period(every), ghost: ghostOf(state, name, every) });
  }
  return [...found.values()];
}

function ghostOf(state, name, every) {
  const last = every.at(-1), placed = every.findLast((point) => point[N] !== null);
  const silent = state.vehicles.some((one) => one.silent && one.name === name), old = !state.ended && name === chosen.slice(0, chosen.lastIndexOf("/")) && stale();
  if (!placed || (placed === last && !silent && !old)) return null;
  const waited = old ? (performance.now() - newestAt) / 1000 : 0, age = Math.max(0, (state.at ?? Math.max(state.time_s, last[T])) - placed[T]) + waited;
  const search = state.team.find((one) => one.vehicle === name) ?? state.search, from = search?.take_off ?? [0, 0];
  const seen = age < 100 ? `${age.toFixed(0)} s` : `${(age / 60).toFixed(0)} min`;
  return { place: [placed[N], placed[E], placed[YAW] ?? 0], words: `last known ${seen} ago, ${away([placed[N] - from[0], placed[E] - from[1]])} ${search ? "take-off" : "home"}` };
}

// Return the transmitters of the chosen vehicle: vehicles with homes of their own have their own.
function own(transmitters) {
  const vehicle = chosen.slice(0, chosen.lastIndexOf("/"));
  return transmitters.filter((one) => one.of.includes(vehicle) || !chosen);
}

// Return the search of the chosen vehicle.
function mine(state) {
  const vehicle = chosen.slice(0, chosen.lastIndexOf("/"));
  return state.team.find((one) => one.vehicle === vehicle) ?? state.search;
}

function describe(state, last, shown) {
  const ghosts = vehicles().filter((one) => one.ghost), ghost = ghosts.find((one) => one.key === chosen)?.ghost;
  const parts = [ghost ? `vehicle ${ghost.words}` : last && last[N] !== null ? `vehicle at ${placed([last[N], last[E]], 1, IN_WORDS)}` : "vehicle not placed"];
  for (const one of ghosts) if (one.key !== chosen) parts.push(`${one.name} ${one.ghost.words}`);
  if (shown) for (const one of own(state.transmitters).slice(0, 8)) parts.push(`transmitter ${one.id} at ${placed(one.place, 1, IN_WORDS)}`);
  for (const { vehicle, found } of [...(state.search ? [state.search] : []), ...state.team]) if (found) parts.push(`${vehicle ? `${vehicle}: ` : ""}place found at ${placed(found.place, 1, IN_WORDS)}`);
  return `Map: ${parts.join("; ")}. Arrow keys move it, plus and minus zoom.`;
}

function showChoice() {
  $("choose").hidden = store.keys.length < 2;
  if ([...$("receiver").options].map((one) => one.value).join() === store.keys.join()) return;
  $("receiver").replaceChildren(...store.keys.map((key) => el("option", { value: key }, key)));
  $("receiver").value = chosen;
}

// Signs of the map: label, and path of a line; its class has the colour.
const SIGNS = {
  vehicle: ["vehicle, receiver", "M5 1L17 13M17 1L5 13M11 1v5"], track: ["track", "M0 10Q8 0 22 5"], ghost: ["last known place", "M11 0a7 7 0 1 0 .1 0"],
  bearing: ["direction, or opposite", "M0 7H22M17 3l5 4-5 4"], home: ["take-off", "M6 2h10v10H6z"],
  transmitter: ["transmitter, dipole", "M2 7H20M16 3l4 4-4 4"], flux: ["flux line", "M0 12Q11-4 22 12"], equal: ["equal d", "M0 7H22"],
  mid: ["within 50 m", "M2 7H20"], inner: ["inner zone", "M2 7H20"],
  dots: ["hypothesis", "M4 7h.1M11 7h.1M18 7h.1"], belief: ["estimate, 2σ", "M2 7a9 5 0 1 0 18 0a9 5 0 1 0-18 0"], goal: ["goal", "M11 0V14M4 7H18"],
  cross: ["victim", "M6 2l10 10M16 2L6 12"], searched: ["searched", "M2 7H20"],
};

function showLegend(state, shown) {
  const search = mine(state), lines = shown && field.transmitters.length, every = vehicles().filter((one) => one.points.some((point) => point[N] !== null));
  const wanted = Object.keys(SIGNS).filter((name) => ({
    vehicle: every.some((one) => !one.ghost), track: every.length, ghost: every.some((one) => one.ghost), bearing: every.length, home: search,
    transmitter: shown && state.transmitters.length, flux: lines, equal: lines, mid: lines, inner: lines,
    dots: search?.hypotheses.length && !search.found, belief: search?.covariance, goal: search?.goal && !search.found, cross: search?.victims.length, searched: search?.area,
  })[name]);
  if (wanted.join() === legend) return;
  legend = wanted.join();
  $("legend").replaceChildren(...wanted.map((name) => {
    const [text, d] = SIGNS[name];
    return el("li", {}, svg("svg", { viewBox: "0 0 22 14", "aria-hidden": "true" }, svg("path", { d, class: `sign-${name}` })), text);
  }));
}

// Put time and receiver into the address, so that it can be sent to others.
function showLink(state) {
  const parts = new URLSearchParams({ ...(player.span && !player.playing && state.at !== undefined ? { t: state.at.toFixed(2) } : {}), ...(store.keys.length > 1 ? { r: chosen } : {}) });
  const hash = parts.size ? `#${parts}` : "";
  if (!player.playing && location.hash !== hash) history.replaceState(null, "", hash || location.pathname);
}

function showBanner() {
  const ended = store.state?.ended;
  let text = failures >= 2 ? "No connection: the program has ended, or the network is down. The page has the last known state." : "";
  if (ended) text = $("outcome").hidden ? `The run is over: ${ended}` : "";
  $("banner").hidden = !text;
  const level = store.state?.failed ? "bad" : "info";
  $("banner").dataset.level = ended ? level : "warn";
  if ($("banner").textContent !== text) $("banner").textContent = text;
}

$("truth").addEventListener("click", () => {
  truth = !truth;
  $("truth").setAttribute("aria-pressed", truth);
  plotted = 0;
  show();
});
$("sound").addEventListener("click", () => {
  const on = $("sound").getAttribute("aria-pressed") !== "true";
  $("sound").setAttribute("aria-pressed", on);
  setTone(on);
});
// Fill the screen with the receiver.
function setFull(on) {
  document.documentElement.classList.toggle("full", on);
  $("full").setAttribute("aria-pressed", on);
  $("full").textContent = on ? "Close" : "Large";
  if (on) document.documentElement.requestFullscreen?.().catch(() => {}); // some browsers refuse
  else if (document.fullscreenElement) document.exitFullscreen();
  show();
}
$("full").addEventListener("click", () => setFull($("full").textContent === "Large"));
document.addEventListener("fullscreenchange", () => { if (!document.fullscreenElement && $("full").textContent === "Close") setFull(false); });
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return;
  if (event.key === " " && !event.target.matches("button, summary, a") && player.span) { player.play(!player.playing); event.preventDefault(); return; }
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (step && player.span && event.target.id !== "map") { player.go(player.at + step * period(points())); event.preventDefault(); return; }
  if (event.key === "r" || event.key === "R") $("full").click();
  else if (event.key === "m" || event.key === "M") $("mark").click();
  else if (event.key === "t" || event.key === "T") $("sound").click();
  else if (event.key === "Escape" && $("full").textContent === "Close") setFull(false);
});
$("mark").addEventListener("click", () => {
  if (!store.state?.lesson) return;
  mark(store.state, points().at(-1));
  store.state.search = null; // it is made again, with this mark
  show();
});
function choose(key) { chosen = $("receiver").value = key; plotted = 0; show(); }
$("receiver").addEventListener("change", () => choose($("receiver").value));
// Choose the receiver of a vehicle by a click; a drag moves the map.
let pressed = null;
$("map").addEventListener("pointerdown", (event) => { pressed = [event.offsetX, event.offsetY]; });
$("map").addEventListener("pointerup", (event) => {
  if (!pressed || Math.hypot(event.offsetX - pressed[0], event.offsetY - pressed[1]) > 6) return;
  const key = vehicleAt(event.offsetX, event.offsetY);
  if (key && key !== chosen) choose(key);
});
for (const button of document.querySelectorAll("[data-window]")) {
  button.addEventListener("click", () => {
    for (const other of document.querySelectorAll("[data-window]")) other.setAttribute("aria-pressed", other === button);
    setSpan(Number(button.dataset.window));
    plotted = 0;
    show();
  });
}
view.onMode = (mode) => { $("fit").setAttribute("aria-pressed", mode === "fit"); $("follow").setAttribute("aria-pressed", mode === "follow"); };
$("fit").addEventListener("click", () => view.set("fit"));
$("follow").addEventListener("click", () => view.set("follow"));
$("closer").addEventListener("click", () => view.zoom(1.4));
$("wider").addEventListener("click", () => view.zoom(1 / 1.4));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { forgetColours(); forgetPlots(); legend = ""; plotted = 0; show(); });
poll();
