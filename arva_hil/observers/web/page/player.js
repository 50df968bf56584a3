// The player of a record: the chosen time, and playing from there.

import { clock } from "./store.js";

const $ = (id) => document.getElementById(id);

export class Player {
  constructor(changed) {
    this.changed = changed;
    this.span = null;
    const wanted = Number.parseFloat(new URLSearchParams(location.hash.slice(1)).get("t"));
    this.at = Number.isFinite(wanted) ? wanted : null; // of a link
    this.asked = null;
    this.playing = false;
    this.before = 0;
    $("slider").addEventListener("input", () => { this.at = Number($("slider").value); this.show(); this.changed(); });
    $("play").addEventListener("click", () => this.play(!this.playing));
  }

  // Shows another time, seconds.
  go(at) {
    if (!this.span) return;
    if (this.playing) this.play(false);
    this.at = Math.min(this.span[1], Math.max(this.span[0], at));
    this.show();
    this.changed();
  }

  play(on) {
    if (on && this.at >= this.span[1]) this.at = this.span[0];
    this.playing = on;
    this.before = performance.now();
    $("play").setAttribute("aria-pressed", on);
    $("play").textContent = on ? "Pause" : "Play";
    this.changed();
  }

  // The part of a request that says which time; a record begins with its end, so that all of it is seen.
  query() {
    if (this.playing) {
      const now = performance.now();
      this.at = Math.min(this.span[1], this.at + ((now - this.before) / 1000) * Number($("speed").value));
      this.before = now;
      if (this.at >= this.span[1]) this.play(false);
    }
    this.asked = this.at;
    return `&at=${this.at ?? "end"}`;
  }

  take(state) {
    if (!state.span) return;
    const first = this.span === null;
    this.span = state.span;
    if (first) {
      $("player").hidden = false;
      $("slider").min = state.span[0];
      $("slider").max = state.span[1];
      this.at = this.asked = state.at;
    }
    this.show();
  }

  show() {
    $("slider").value = this.at;
    $("slider").setAttribute("aria-valuetext", clock(this.at));
    $("at").textContent = `${clock(this.at)} of ${clock(this.span[1])}`;
  }

  // Whether another time is wanted than the one that was asked for.
  hurried() { return !this.playing && this.at !== this.asked; }
}
