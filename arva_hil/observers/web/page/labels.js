// Words on the map. A name stands beside its thing, whole, where it hides no other name and no vehicle.

import { css } from "./store.js";

export const FONT = "600 12px system-ui, sans-serif";
const HEIGHT = 16, GAP = 4;

// [dx, dy, align] from a thing of radius `r` to where its name may stand, the best first.
export const BESIDE = (r) => [[r, -r, "left"], [-r, -r, "right"], [r, r, "left"], [-r, r, "right"], [0, -r - 8, "center"], [0, r + 8, "center"]];
export const BELOW = (r) => [[0, r, "center"], [0, -r, "center"], [r, 0, "left"], [-r, 0, "right"]];

export function label(ink, text, x, y, colour, font = FONT, align = "left") {
  ink.save();
  ink.setLineDash([]);
  ink.font = font;
  ink.textAlign = align;
  ink.textBaseline = "middle";
  ink.lineJoin = "round";
  ink.lineWidth = 4;
  ink.strokeStyle = css("--ground");
  ink.strokeText(text, x, y);
  ink.fillStyle = colour;
  ink.fillText(text, x, y);
  ink.restore();
}

function shared([l, t, r, b], [l2, t2, r2, b2]) {
  return Math.max(0, Math.min(r, r2) - Math.max(l, l2)) * Math.max(0, Math.min(b, b2) - Math.max(t, t2));
}

// The names of one drawing; remembers on which side each stood, so that it does not jump.
export class Names {
  constructor() {
    this.sides = [];
    this.clear();
  }

  clear() {
    this.names = [];
    this.things = [];
  }

  // No name should hide what is within `r` pixels of (x, y).
  avoid(x, y, r) { this.things.push([x - r, y - r, x + r, y + r]); }

  // Nor should it stand under one of the elements over the map.
  avoidElement({ offsetLeft: x, offsetTop: y, offsetWidth: w, offsetHeight: h }) { if (w) this.things.push([x, y, x + w, y + h]); }

  // `spots`: see BESIDE. Names with a smaller `rank` choose first.
  add(text, x, y, colour, rank, spots) { this.names.push({ key: this.names.length, text, x, y, colour, rank, spots }); }

  // Where each name stands: {name, x, y, align, box}; `box`: left, top, right, bottom. If no place is free, it hides as little as it can.
  arranged(width, height, measure) {
    const full = [...this.things], inner = [GAP, GAP, width - GAP, height - GAP];
    return this.names.toSorted((a, b) => a.rank - b.rank).map((name) => {
      const across = measure(name.text), before = this.sides[name.key] ?? 0;
      let best = null;
      for (const side of [before, ...name.spots.keys()]) {
        const [dx, dy, align] = name.spots[side] ?? name.spots[0], x = name.x + dx, y = name.y + dy;
        const left = x - (align === "left" ? 0 : align === "right" ? across : across / 2);
        const box = [left, y - HEIGHT / 2, left + across, y + HEIGHT / 2];
        const hidden = full.reduce((sum, other) => sum + shared(box, other), across * HEIGHT - shared(box, inner));
        if (!best || hidden < best.hidden - 1) best = { name, x, y, align, box, hidden, side };
        if (best.hidden < 1) break;
      }
      this.sides[name.key] = best.side;
      full.push(best.box);
      return best;
    });
  }

  draw(ink, width, height) {
    ink.font = FONT;
    for (const { name, x, y, align } of this.arranged(width, height, (text) => ink.measureText(text).width)) label(ink, name.text, x, y, name.colour, FONT, align);
  }
}
