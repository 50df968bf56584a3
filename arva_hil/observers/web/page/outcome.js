// The outcome of a search: victims found, their places, what is missing; the list of victims with their marks.

import { metres } from "./display.js";
import { CM, DOUBT, ID, SLOTS, el, precise, signOf } from "./store.js";

const $ = (id) => document.getElementById(id);
let shownCard = "";

// Return the outcome of the searches of a run; null without one. `transmitters`: with true places; empty if hidden.
export function outcomeOf(state, transmitters) {
  const searches = state.team.length ? state.team : [state.search].filter(Boolean);
  if (!searches.length) return null;
  const victims = searches.flatMap((search) => search.victims.map((one) => ({ ...one, by: search.vehicle, doubt: search.doubt ?? `not sure: ${DOUBT}` })));
  const received = new Set(searches.flatMap((search) => search.heard.map(([id]) => id)));
  const wanted = state.team.length || searches[0].wanted === null ? transmitters.length || null : searches[0].wanted;
  for (const [i, one] of victims.entries()) {
    one.name = one.id ?? `place ${i}`;
    const real = transmitters.filter(({ id }) => id === one.id || one.id === null).map(({ place: [n, e] }) => Math.hypot(n - one.place[0], e - one.place[1]));
    one.off_m = real.length ? Math.min(...real) : null;
  }
  const names = (some) => new Set(some.map((one) => one.name)), found = names(victims), count = names(victims.filter((one) => one.sure)).size;
  const lacks = wanted === null ? victims.at(-1)?.left > 0 || !found.size : found.size < wanted;
  const missing = lacks && !found.has("place 0") ? transmitters.filter(({ id }) => !found.has(id)).map(({ id }) => [id, received.has(id) ? "not found, but received" : "not found: not received"]) : [];
  const over = Boolean(state.ended) || searches.every((search) => search.ended), unsure = found.size - count;
  const ends = [...new Set(searches.map((search) => search.ended).filter(Boolean))];
  const why = state.failed && !ends.length ? state.ended : ends.filter((text) => text !== "found").join("; ");
  let title = `${count} ${wanted === null ? "" : `of ${wanted} `}${state.lesson && !over ? "marked" : "found"}${unsure ? `, ${unsure} not sure` : ""}`;
  if (wanted === 1 && found.size === 1) title = unsure ? "Not sure" : "Found";
  if (over && !found.size) title = searches.some((search) => search.begun) ? "Not found" : "No search";
  const level = lacks || unsure ? "warn" : "good";
  return { over, title, why, victims, missing, level: found.size ? level : "bad" };
}

// Update the card at the top, which appears at the end of the search.
export function showOutcome(outcome) {
  const key = JSON.stringify(outcome);
  if (key === shownCard) return;
  shownCard = key;
  const card = $("outcome");
  card.hidden = !outcome?.over;
  if (card.hidden) return;
  card.dataset.level = outcome.level;
  $("outcome-title").textContent = outcome.title;
  $("outcome-why").textContent = outcome.why;
  $("outcome-list").replaceChildren(...outcome.victims.map(foundRow), ...outcome.missing.map(([id, why]) => el("li", { "data-level": "bad" },
    el("span", { class: "sign", "aria-hidden": "true" }), el("b", {}, signOf(id), `Transmitter ${id}`), el("span", {}, why))));
}

function foundRow(one, i) {
  const facts = [one.off_m === null ? "" : `${precise(one.off_m, 1)} off`, one.took_s === null ? "" : `${one.took_s.toFixed(0)} s`, one.sure ? "" : one.doubt, one.marked ? "marked" : "", one.by ? `by ${one.by}` : ""];
  const row = el("li", { "data-level": one.sure ? "good" : "warn" }, el("span", { class: "sign", "aria-hidden": "true" }),
    el("b", {}, signOf(one.id), `Victim ${i + 1}${one.id === null ? "" : ` (transmitter ${one.id})`}`), el("span", {}, facts.filter(Boolean).join(", ")));
  if (one.lat_lon) {
    const text = one.lat_lon.map((degrees) => degrees.toFixed(7)).join(", "), place = el("code", {}, text), button = el("button", { type: "button", "aria-label": `Copy ${text}` }, "Copy");
    button.addEventListener("click", async () => { await copy(text, place); button.textContent = "Copied"; });
    row.append(place, button, el("a", { href: `geo:${text.replace(" ", "")}` }, "Open"),
      el("button", { type: "button", popovertarget: `qr-${i}` }, "QR code"), el("img", { id: `qr-${i}`, popover: "", src: one.qr, alt: `QR code of ${text}` }));
  }
  return row;
}

// Without HTTPS a browser has no clipboard, except on this computer. Then the text is selected for Ctrl-C or a phone's menu.
async function copy(text, element) {
  getSelection().selectAllChildren(element);
  try { await navigator.clipboard.writeText(text); } catch { document.execCommand("copy"); }
}

// Update the list, as on a transceiver: marked, found, next, other received transmitters, with their newest distance.
export function showVictims(search, outcome, point) {
  $("count").textContent = outcome && search ? outcome.title : "";
  const slots = (point?.[SLOTS] ?? []).filter((slot) => slot[CM] > 0), rows = new Map();
  for (const one of search?.victims ?? []) {
    const state = one.marked ? "marked" : "found";
    rows.set(one.id ?? `place ${rows.size}`, one.sure ? state : "not sure");
  }
  if (search && !search.ended && search.target !== null && !rows.has(search.target)) rows.set(search.target, "next");
  for (const slot of slots) if (slot[ID] !== null && !rows.has(slot[ID])) rows.set(slot[ID], "received");
  $("victims").hidden = !rows.size;
  const away = (id) => {
    const cm = Math.min(...slots.filter((slot) => slot[ID] === id).map((slot) => slot[CM]));
    return cm < Infinity ? `${metres(cm)} m` : "–";
  };
  $("victims").replaceChildren(...[...rows].map(([id, state]) => el("li", { "data-state": state },
    signOf(typeof id === "number" ? id : null), el("b", {}, typeof id === "number" ? `Nº ${id}` : "Victim"), el("span", {}, state),
    el("span", { class: "value" }, away(id)))));
}
