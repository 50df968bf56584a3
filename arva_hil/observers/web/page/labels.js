// Labels on the map. A label is beside its object, complete, and covers no other label and no vehicle.

import { css } from "./store.js";

export const FONT = "600 12px system-ui, sans-serif";
const HEIGHT = 16, GAP = 4;

// [dx, dy, align] from an object of radius `r` to the possible places of its label, the best first.
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

// The labels of one drawing. Remembers the side of each, so that it does not jump.
export class Names {
  constructor() {
    this.sides = [];
    this.clear();
  }

  clear() {
    this.names = [];
    this.things = [];
  }

  // Keep labels away from `r` pixels around (x, y).
  avoid(x, y, r) { this.things.push([x - r, y - r, x + r, y + r]); }

  // Keep labels away from an element over the map.
  avoidElement({ offsetLeft: x, offsetTop: y, offsetWidth: w, offsetHeight: h }) { if (w) this.things.push([x, y, x + w, y + h]); }

  // Add a label. `spots`: see BESIDE. Labels with a smaller `rank` are placed first.
  add(text, x, y, colour, rank, spots) { this.names.push({ key: this.names.length, text, x, y, colour, rank, spots }); }

  // Return the place of each label whose object is visible: {name, x, y, align, box}; `box`: left, top, right, bottom.
  // If no place is free, it covers as little as possible.
  arranged(width, height, measure) {
    const full = [...this.things], inner = [GAP, GAP, width - GAP, height - GAP];
    return this.names.filter(({ x, y }) => x >= 0 && y >= 0 && x <= width && y <= height).sort((a, b) => a.rank - b.rank).map((name) => {
      const across = measure(name.text), before = this.sides[name.key] ?? 0;
      let best = null;
      for (const side of [before, ...name.spots.keys()]) {
        const [dx, dy, align] = name.spots[side] ?? name.spots[0], x = name.x + dx, y = name.y + dy;
        const left = x - { left: 0, right: across, center: across / 2 }[align];
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
