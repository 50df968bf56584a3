// Beeps as a receiver does: faster and higher at a smaller distance. Off at the start, because browsers require a click.

import { CM } from "./store.js";
import { nearest } from "./display.js";

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
