// The display of the receiver, as on a transceiver: distance, arrow with its ambiguity, zone, channels.

import { AGE, CM, DELTA, ID, RANGE, SEQ, SLOTS, T, ZONE, el, inTime, signOf, svg } from "./store.js";

const ZONES = ["no signal", "mid", "inner"];
const WORDS = ["", "distance and direction", "distance only: no direction"];
const $ = (id) => document.getElementById(id);

for (let degrees = -90; degrees <= 90; degrees += 15) {
  const half = degrees % 45 ? 2.5 : 5;
  $("ticks").append(svg("line", { x1: 120, x2: 120, y1: 36 - half, y2: 36 + half, transform: `rotate(${degrees} 120 120)` }));
}

const text = (node, value) => { if (node.textContent !== value) node.textContent = value; };

export function nearest(point) {
  let best = null;
  for (const slot of point?.[SLOTS] ?? []) if (slot[CM] > 0 && (!best || slot[CM] < best[CM])) best = slot;
  return best;
}

export function metres(cm) { return cm < 1000 ? (cm / 100).toFixed(2) : (cm / 100).toFixed(1); }

export function signed(degrees) { return `${degrees < 0 ? "−" : "+"}${Math.abs(degrees)}°`; }

// A direction and its opposite are the same reading: turn the arrow by less than 90°, and keep the solid head in front.
let turned = 0;
function turn(degrees) {
  const halves = Math.round((turned - degrees) / 180);
  turned = degrees + 180 * halves;
  $("arrow").style.transform = `rotate(${turned}deg)`;
  $("heads").setAttribute("transform", halves % 2 ? "rotate(180 120 120)" : "");
}

// `point`: the newest, undefined without one; `stale`: no new one comes; `count`: number of readings so far.
export function showDisplay(point, stale, count) {
  const panel = document.querySelector(".device"), best = nearest(point);
  const zone = best ? (best[ZONE] || 1) : 0;
  panel.dataset.zone = zone;
  panel.classList.toggle("stale", stale);
  text($("distance"), best ? metres(best[CM]) : "––");
  $("unit").hidden = !best;
  const label = $("zone");
  text(label, best && !best[ZONE] ? "received" : ZONES[zone] ?? `zone ${zone}`);
  label.dataset.zone = best ? best[ZONE] : 0;
  const pointed = best && zone !== 2;
  $("arrow").style.display = pointed ? "" : "none";
  $("cross").style.display = zone === 2 ? "" : "none";
  $("cross").removeAttribute("hidden");
  if (pointed) turn(best[DELTA]);
  text($("direction"), pointed ? `${signed(best[DELTA])}, or behind` : WORDS[zone] ?? "");
  text($("dial-title"), best ? `${metres(best[CM])} metres, ${pointed ? `${best[DELTA]} degrees or in the opposite direction` : "no direction"}` : "no signal");
  const slots = point?.[SLOTS] ?? [];
  text($("heard"), String(slots.filter((slot) => slot[CM] > 0).length));
  text($("number"), point ? String(count) : "–");
  $("number").dataset.seq = point ? point[SEQ] : "";
  $("number").dataset.time = point ? point[T] : "";
  text($("age"), point?.[AGE] == null ? "–" : inTime(point[AGE]));
  showChannels(slots);
}

function showChannels(slots) {
  const body = document.querySelector("#channels tbody");
  while (body.rows.length > slots.length) body.lastElementChild.remove();
  slots.forEach((slot, i) => {
    const row = body.rows[i] ?? body.appendChild(el("tr", {}, el("td"), el("td"), el("td"), el("td"), el("td", { class: "true" })));
    const received = slot[CM] > 0, cells = row.cells, key = slot.join();
    if (row.dataset.key === key) return;
    row.dataset.key = key;
    row.className = received ? "" : "none";
    cells[0].replaceChildren(...(received ? [signOf(slot[ID]), slot[ID] === null ? "?" : String(slot[ID])] : ["–"]));
    text(cells[1], received ? `${metres(slot[CM])} m` : "–");
    text(cells[2], received && slot[ZONE] !== 2 ? signed(slot[DELTA]) : "–");
    text(cells[3], (received && slot[ZONE] && ZONES[slot[ZONE]]) || "–");
    text(cells[4], slot[RANGE] === null || slot[ID] === null ? "–" : `${slot[RANGE].toFixed(2)} m`);
  });
}

// Beeps as a receiver does: faster and higher at a smaller distance. Off at the start, because browsers require a click.
let context = null, timer = 0, current = null;

export function setTone(on) {
  clearTimeout(timer);
  if (!on) return void context?.suspend();
  context ??= new AudioContext();
  context.resume();
  beep();
}

export function updateTone(point, stale) { current = stale ? null : nearest(point); }

function beep() {
  let pause = 400;
  if (current && context.state === "running") {
    const share = Math.min(1, Math.max(0, Math.log(current[CM] / 30) / Math.log(5000 / 30))); // 0 near … 1 far
    const now = context.currentTime, tone = context.createOscillator(), gain = context.createGain();
    tone.frequency.value = 1900 - 1400 * share;
    gain.gain.setValueAtTime(0.0001, now);
    gain.gain.exponentialRampToValueAtTime(0.16, now + 0.01);
    gain.gain.exponentialRampToValueAtTime(0.0001, now + 0.09);
    tone.connect(gain).connect(context.destination);
    tone.start(now);
    tone.stop(now + 0.1);
    pause = 130 + 1000 * share;
  }
  timer = setTimeout(beep, pause);
}
