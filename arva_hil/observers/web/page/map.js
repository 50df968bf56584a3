// The map: vehicles, tracks, transmitters, the lines of the field and the estimate of a search, in local metres.

import { CM, D, DELTA, E, ID, N, YAW, ZONE, colourOf, css, fixed, shapeOf } from "./store.js";
import { nearest } from "./display.js";
import { axes } from "./health.js";
import { BELOW, BESIDE, FONT, Names, label } from "./labels.js";
import { View } from "./view.js";

const canvas = document.getElementById("map"), ink = canvas.getContext("2d");
const still = matchMedia("(prefers-reduced-motion: reduce)");
const FRAME_MS = 30; // least time between two drawings
let scene = null, due = false, drawn = 0;
let names = new Names(), eye = null; // the view that is drawn: of the map, or of the inset
const OVER = [document.getElementById("legend"), document.querySelector(".map .tools")];
const glides = new Map(); // by receiver: from, to, start, length

export const view = new View(canvas, ask);
eye = view;

export function showMap(next) {
  scene = next;
  for (const vehicle of scene.vehicles) glide(vehicle);
  ask();
}

// Return the receiver of the vehicle at a pixel; null without one.
export function vehicleAt(x, y) {
  const near = scene?.vehicles.map((one) => [one.key, one.ghost?.place ?? (glides.get(one.key) && now(glides.get(one.key)))]).filter(([, place]) => place)
    .map(([key, [n, e]]) => [key, Math.hypot(view.x(e) - x, view.y(n) - y)]).sort((a, b) => a[1] - b[1])[0];
  return near && near[1] < 22 ? near[0] : null;
}

function ask() {
  if (due) return;
  due = true;
  requestAnimationFrame(draw);
}

// Move a vehicle smoothly from one reading to the next.
function glide(vehicle) {
  const last = vehicle.points.at(-1), known = glides.get(vehicle.key);
  const to = last && last[N] !== null ? [last[N], last[E], last[YAW] ?? 0] : null;
  if (known && known.point === last) return;
  const from = to && known?.to ? now(known) : to;
  const jump = !from || !to || Math.hypot(to[0] - from[0], to[1] - from[1]) > 30 || still.matches;
  glides.set(vehicle.key, { point: last, from: jump ? to : from, to, start: performance.now(), length: jump ? 1 : Math.min(1200, Math.max(80, vehicle.period * 1000)) });
}

function now({ from, to, start, length }) {
  if (!to) return null;
  const share = Math.min(1, (performance.now() - start) / length);
  const turn = ((to[2] - from[2] + 540) % 360) - 180;
  return [from[0] + (to[0] - from[0]) * share, from[1] + (to[1] - from[1]) * share, from[2] + turn * share, share < 1];
}

// Add the tracks to a drawing, in metres, east and north.
function trace(on, vehicles) {
  on.beginPath();
  for (const { points } of vehicles) {
    let pen = false;
    for (const point of points) {
      if (point[N] === null) pen = false;
      else if (pen) on.lineTo(point[E], point[N]);
      else { on.moveTo(point[E], point[N]); pen = true; }
    }
  }
  on.lineJoin = on.lineCap = "round";
}

const small = document.createElement("canvas").getContext("2d", { willReadFrequently: true }), SIDE = 100;

// Return the share of a search's area within half a strip of a track, %; null if the area is not known.
export function searched({ area, strip_m }, vehicles) {
  if (!area || !(strip_m > 0)) return null;
  const [south, west, north, east] = area, across = SIDE / (east - west), along = SIDE / (north - south);
  small.canvas.width = small.canvas.height = SIDE; // this also clears it
  small.setTransform(across, 0, 0, -along, -west * across, north * along);
  small.lineWidth = strip_m;
  trace(small, vehicles);
  small.stroke();
  return small.getImageData(0, 0, SIDE, SIDE).data.filter((value, i) => i % 4 === 3 && value > 127).length / (SIDE * SIDE) * 100;
}

function drawSearched({ area, strip_m }) {
  if (!area || !(strip_m > 0)) return;
  const [south, west, north, east] = area;
  ink.save();
  ink.transform(view.scale, 0, 0, -view.scale, view.x(0), view.y(0));
  ink.beginPath();
  ink.rect(west, south, east - west, north - south);
  ink.strokeStyle = css("--soft");
  ink.lineWidth = 1.5 / view.scale;
  ink.setLineDash([8 / view.scale, 6 / view.scale]);
  ink.stroke();
  ink.setLineDash([]);
  ink.clip();
  trace(ink, scene.vehicles);
  ink.strokeStyle = css("--good");
  ink.lineWidth = strip_m;
  ink.globalAlpha = 0.13;
  ink.stroke();
  ink.restore();
}

function bounds() {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const add = (n, e, m = 0) => {
    if (n === null || !Number.isFinite(n) || !Number.isFinite(e)) return;
    box[0] = Math.min(box[0], n - m); box[1] = Math.min(box[1], e - m); box[2] = Math.max(box[2], n + m); box[3] = Math.max(box[3], e + m);
  };
  for (const vehicle of scene.vehicles) for (const point of vehicle.points) add(point[N], point[E], 1);
  if (scene.truth) for (const one of scene.transmitters.slice(0, 32)) add(one.place[0], one.place[1], 4);
  if (scene.search) {
    add(...scene.search.take_off, 1);
    const { area, target, victims } = scene.search;
    if (area && target === null && !victims.length) { add(area[0], area[1]); add(area[2], area[3]); }
    for (const [n, e, share] of scene.search.hypotheses) if (share > 0.02) add(n, e, 1);
    if (scene.search.found) add(...scene.search.found.place, 3);
    for (const one of scene.search.victims) add(...one.place, 3);
  }
  for (const { found } of scene.team) if (found) add(...found.place, 3);
  return box[0] === Infinity ? [-25, -25, 25, 25] : box;
}

function draw(time) {
  if (time - drawn < FRAME_MS) return void requestAnimationFrame(draw);
  drawn = time;
  due = false;
  names.clear();
  for (const element of OVER) names.avoidElement(element);
  if (!scene || !view.width) return;
  const ratio = Math.min(3, devicePixelRatio || 1), w = Math.round(view.width * ratio), h = Math.round(view.height * ratio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  ink.setTransform(ratio, 0, 0, ratio, 0, 0);
  const own = scene.vehicles.find((vehicle) => vehicle.key === scene.chosen), here = own && glides.get(own.key) && now(glides.get(own.key));
  const field = scene.field.filter((lines) => scene.all[lines.index]?.id === lines.id && scene.transmitters.includes(scene.all[lines.index]));
  if (view.mode === "fit") view.frame(bounds(), OVER[0].offsetWidth);
  else if (view.mode === "follow" && here) { view.north = here[0]; view.east = here[1]; }
  ink.fillStyle = css("--ground");
  ink.fillRect(0, 0, view.width, view.height);
  if (scene.background) drawBackground(scene.background);
  if (scene.truth) for (const one of field) drawZones(one);
  drawGrid();
  const target = own && nearest(own.points.at(-1))?.[ID];
  if (scene.truth) for (const one of field) drawField(one, field.length < 2, target);
  if (scene.search) drawSearched(scene.search);
  for (const vehicle of scene.vehicles) drawTrack(vehicle, vehicle === own);
  for (const { found } of scene.team) if (found) drawPlace(...found.place, "found");
  if (scene.search) drawSearch(scene.search);
  if (scene.truth) scene.transmitters.forEach(drawTransmitter);
  let moving = false;
  for (const vehicle of scene.vehicles) if (vehicle.ghost) drawGhost(vehicle);
  scene.vehicles.forEach((vehicle) => {
    if (vehicle.ghost) return;
    const place = glides.get(vehicle.key) && now(glides.get(vehicle.key));
    if (!place) return;
    drawVehicle(place, vehicle, vehicle === own);
    moving ||= place[3];
  });
  const inset = near(here);
  if (inset) names.avoidElement(inset);
  names.draw(ink, view.width, view.height);
  drawScale(inset ? inset.offsetLeft : view.width);
  if (inset) drawInset(inset, own, here);
  if (moving) ask();
}

// Add a line of the field. `one`: its transmitter, which may have moved since the line was computed.
function path(line, one, closed = false) {
  const [north, east] = scene.all[one.index].place, n = north - one.place[0], e = east - one.place[1];
  ink.beginPath();
  for (let i = 0; i < line.length; i += 2) ink.lineTo(eye.x(line[i + 1] + e), eye.y(line[i] + n));
  if (closed) ink.closePath();
}

const picture = new Image();
let pictured = ""; // its address, another one for each run
picture.addEventListener("load", ask);

function drawBackground({ reach_m, from }) {
  const wanted = from ?? `background.png?run=${scene.run}`;
  if (pictured !== wanted) picture.src = pictured = wanted;
  if (picture.naturalWidth) ink.drawImage(picture, view.x(-reach_m), view.y(reach_m), 2 * reach_m * view.scale, 2 * reach_m * view.scale);
}

function drawZones(one) {
  const outer = one.equal_d.find(([d]) => d === 50);
  if (outer) { path(outer[1], one, true); ink.fillStyle = css("--mid"); ink.globalAlpha = scene.background ? 0.3 : 0.8; ink.fill(); ink.globalAlpha = 1; }
  if (one.inner.length) { path(one.inner, one, true); ink.fillStyle = css("--inner"); ink.fill(); ink.strokeStyle = css("--warn"); ink.lineWidth = 1.2; ink.stroke(); }
}

function drawGrid() {
  const step = nice(70 / eye.scale);
  ink.strokeStyle = css("--grid");
  ink.lineWidth = 1;
  ink.beginPath();
  const west = eye.east - eye.width / 2 / eye.scale, south = eye.north - eye.height / 2 / eye.scale;
  for (let e = Math.ceil(west / step) * step; eye.x(e) < eye.width; e += step) { const x = Math.round(eye.x(e)) + 0.5; ink.moveTo(x, 0); ink.lineTo(x, eye.height); }
  for (let n = Math.ceil(south / step) * step; eye.y(n) > 0; n += step) { const y = Math.round(eye.y(n)) + 0.5; ink.moveTo(0, y); ink.lineTo(eye.width, y); }
  ink.stroke();
}

function nice(metres) {
  const power = 10 ** Math.floor(Math.log10(metres)), share = metres / power;
  return power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10);
}

const LABELS = [0.625, 0.375, 0.125, 0.875, 0.5, 0, 0.7, 0.3, 0.56, 0.44, 0.2, 0.8]; // places on a line, the best first
function visible(x, y) { return x > 30 && x < eye.width - 50 && y > 60 && y < eye.height - 50; }

function drawField(one, alone, target) {
  ink.strokeStyle = alone ? css("--field") : colourOf(one.id);
  ink.lineWidth = 0.9;
  ink.globalAlpha = alone ? 0.6 : 0.35;
  for (const line of one.flux) { path(line, one); ink.stroke(); }
  ink.globalAlpha = alone ? 1 : 0.6;
  ink.setLineDash([2, 4]);
  ink.lineWidth = 1.2;
  for (const [d, line] of one.equal_d) {
    path(line, one, true);
    ink.stroke();
    if (!alone && one.id !== target) continue; // labels of several would cover each other
    const at = LABELS.map((share) => Math.floor((line.length / 2 - 1) * share) * 2)
      .find((i) => visible(eye.x(line[i + 1]), eye.y(line[i])) && Math.hypot(line[i] - one.place[0], line[i + 1] - one.place[1]) * eye.scale > 50);
    if (at !== undefined) label(ink, `${d} m`, eye.x(line[at + 1]), eye.y(line[at]), alone ? css("--soft") : colourOf(one.id), "500 11px system-ui, sans-serif", "center");
  }
  ink.setLineDash([]);
  ink.globalAlpha = 1;
}

function drawTrack(vehicle, own) {
  ink.strokeStyle = own ? css("--track") : css("--soft");
  ink.lineJoin = ink.lineCap = "round";
  ink.lineWidth = own ? 2.4 : 1.6;
  ink.globalAlpha = own ? 0.95 : 0.7;
  ink.beginPath();
  let pen = false, x = 0, y = 0;
  const place = glides.get(vehicle.key) && now(glides.get(vehicle.key)), last = vehicle.points.length - 1;
  vehicle.points.forEach((point, i) => {
    if (point[N] === null) { pen = false; return; }
    const [n, e] = i === last && place ? place : [point[N], point[E]];
    const px = eye.x(e), py = eye.y(n);
    if (pen && i !== last && Math.abs(px - x) + Math.abs(py - y) < 1.5) return; // less than a pixel or two
    if (pen) ink.lineTo(px, py); else ink.moveTo(px, py);
    [pen, x, y] = [true, px, py];
  });
  ink.stroke();
  ink.globalAlpha = 1;
}

function drawTransmitter(one) {
  const x = eye.x(one.place[1]), y = eye.y(one.place[0]), colour = colourOf(one.id);
  const length = 24, [n, e, d] = one.axis, dx = e * length, dy = -n * length, flat = Math.hypot(n, e);
  ink.lineCap = "round";
  for (const [width, style] of [[7, css("--ground")], [4, colour]]) {
    ink.lineWidth = width;
    ink.strokeStyle = style;
    ink.beginPath();
    ink.moveTo(x - dx, y - dy); ink.lineTo(x + dx, y + dy);
    if (flat > 0.2) {
      const angle = Math.atan2(dy, dx);
      for (const turn of [2.6, -2.6]) { ink.moveTo(x + dx, y + dy); ink.lineTo(x + dx + 9 * Math.cos(angle + turn), y + dy + 9 * Math.sin(angle + turn)); }
    }
    ink.stroke();
  }
  ink.save();
  ink.translate(x, y);
  const shape = new Path2D(shapeOf(one.id));
  ink.lineWidth = 3; ink.lineJoin = "round"; ink.strokeStyle = css("--ground"); ink.stroke(shape); ink.fillStyle = colour; ink.fill(shape);
  ink.restore();
  if (flat <= 0.2) { disc(x, y, 4, css("--ground")); if (d > 0) disc(x, y, 1.8, colour); } // a vertical dipole: an arrow from its tip or its tail
  const deep = one.place[2], depth = Math.abs(deep) < 0.05 ? "" : `, ${Math.abs(deep).toFixed(1)} m ${deep > 0 ? "deep" : "up"}`;
  names.avoid(x, y, 8);
  names.add(`Nº ${one.id}${depth}`, x, y, css("--ink"), 1, BELOW(24));
}

function disc(x, y, radius, colour) { ink.beginPath(); ink.arc(x, y, radius, 0, 2 * Math.PI); ink.fillStyle = colour; ink.fill(); }

// Draw the last place of a lost vehicle: dashed, with age, distance and direction.
function drawGhost(vehicle) {
  const [north, east, yaw] = vehicle.ghost.place, x = eye.x(east), y = eye.y(north), colour = css("--warn");
  ink.save();
  ink.translate(x, y);
  ink.rotate((yaw * Math.PI) / 180);
  ink.globalAlpha = 0.6;
  drawFrame(colour, 11);
  ink.restore();
  ink.strokeStyle = colour;
  ink.lineWidth = 2.5;
  ink.setLineDash([5, 5]);
  ink.beginPath(); ink.arc(x, y, 24, 0, 2 * Math.PI); ink.stroke();
  ink.setLineDash([]);
  names.avoid(x, y, 24);
  names.add(`${scene.vehicles.length > 1 ? `${vehicle.name} ` : ""}${vehicle.ghost.words}`, x, y, colour, 0, BESIDE(28));
}

function drawVehicle([north, east, yaw], vehicle, own) {
  const x = eye.x(east), y = eye.y(north), best = own ? nearest(vehicle.points.at(-1)) : null;
  ink.save();
  ink.translate(x, y);
  if (best && best[ZONE] !== 2) drawBearing(yaw + best[DELTA], colourOf(best[ID]), best[CM] / 100 * eye.scale);
  ink.rotate((yaw * Math.PI) / 180);
  const colour = own ? css("--ink") : css("--soft"), r = own ? 11 : 9;
  drawFrame(colour, r);
  ink.fillStyle = own ? css("--track") : colour;
  ink.strokeStyle = css("--ground");
  ink.lineWidth = 1.5;
  ink.beginPath();
  ink.moveTo(0, -r * 1.75); ink.lineTo(r * 0.52, -r * 0.5); ink.lineTo(0, -r * 0.75); ink.lineTo(-r * 0.52, -r * 0.5); ink.closePath();
  ink.fill();
  ink.stroke();
  ink.restore();
  const height = vehicle.points.at(-1)?.[D];
  names.avoid(x, y, 1.3 * r);
  if (scene.vehicles.length > 1) names.add(vehicle.name, x, y, colour, own ? 0 : 3, BESIDE(17));
  else if (height !== null && height !== undefined) names.add(Math.abs(height) < 0.1 ? "less than 10 cm" : `${fixed(-height)} m`, x, y, css("--soft"), 0, BESIDE(17));
}

// Draw the arms and rotors of a multirotor.
function drawFrame(colour, r) {
  ink.lineCap = "round";
  for (const [width, style] of [[6, css("--ground")], [2.6, colour]]) {
    ink.strokeStyle = style;
    ink.lineWidth = width;
    ink.beginPath();
    for (const [sx, sy] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) { ink.moveTo(0, 0); ink.lineTo(sx * r * 0.8, sy * r * 0.8); }
    ink.stroke();
    for (const [sx, sy] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) { ink.beginPath(); ink.arc(sx * r * 0.8, sy * r * 0.8, r * 0.45, 0, 2 * Math.PI); ink.stroke(); }
  }
}

// Draw the direction of the receiver solid, and the opposite direction dashed.
function drawBearing(degrees, colour, far) {
  const angle = ((degrees - 90) * Math.PI) / 180, length = Math.max(44, Math.min(110, far * 0.6)), c = Math.cos(angle), s = Math.sin(angle);
  ink.strokeStyle = ink.fillStyle = colour;
  ink.lineWidth = 3;
  ink.beginPath(); ink.moveTo(20 * c, 20 * s); ink.lineTo(length * c, length * s); ink.stroke();
  ink.beginPath();
  ink.moveTo((length + 9) * c, (length + 9) * s);
  for (const turn of [2.5, -2.5]) ink.lineTo(length * c + 8 * Math.cos(angle + turn), length * s + 8 * Math.sin(angle + turn));
  ink.closePath(); ink.fill();
  ink.setLineDash([4, 6]); ink.lineWidth = 2;
  ink.beginPath(); ink.moveTo(-20 * c, -20 * s); ink.lineTo(-length * c, -length * s); ink.stroke();
  ink.setLineDash([]);
}

function drawSearch(search) {
  const colour = css("--belief"), [n0, e0] = search.take_off;
  ink.strokeStyle = css("--soft");
  ink.lineWidth = 2;
  ink.strokeRect(eye.x(e0) - 6, eye.y(n0) - 6, 12, 12);
  const place = search.found?.place ?? search.mean, covariance = search.found?.covariance ?? search.covariance;
  for (const [n, e, share] of search.found ? [] : search.hypotheses) {
    ink.globalAlpha = 0.35 + 0.5 * share;
    disc(eye.x(e), eye.y(n), 3 + 9 * Math.sqrt(share), colour);
  }
  ink.globalAlpha = 1;
  ink.strokeStyle = colour;
  if (place && covariance) {
    const { a, b, angle } = axes(covariance);
    ink.beginPath();
    ink.ellipse(eye.x(place[1]), eye.y(place[0]), Math.max(2, 2 * a * eye.scale), Math.max(2, 2 * b * eye.scale), angle - Math.PI / 2, 0, 2 * Math.PI);
    ink.globalAlpha = 0.13; ink.fillStyle = colour; ink.fill();
    ink.globalAlpha = 1; ink.lineWidth = 1.8; ink.stroke();
  }
  if (search.goal && !search.found) {
    const x = eye.x(search.goal[1]), y = eye.y(search.goal[0]);
    ink.lineWidth = 2;
    ink.beginPath();
    ink.arc(x, y, 12, 0, 2 * Math.PI);
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { ink.moveTo(x + dx * 7, y + dy * 7); ink.lineTo(x + dx * 18, y + dy * 18); }
    ink.stroke();
  }
  search.victims.forEach((one, at) => drawPlace(...one.place, one.sure ? `victim ${at + 1}` : `victim ${at + 1}, not sure`));
}

function drawPlace(n, e, text) {
  const x = eye.x(e), y = eye.y(n), colour = css("--belief");
  for (const [width, style] of [[7, css("--ground")], [3.4, colour]]) {
    ink.lineWidth = width; ink.strokeStyle = style;
    ink.beginPath();
    ink.moveTo(x - 11, y - 11); ink.lineTo(x + 11, y + 11); ink.moveTo(x - 11, y + 11); ink.lineTo(x + 11, y - 11);
    ink.stroke();
  }
  names.add(text, x, y, colour, 2, [[-16, -14, "right"], ...BESIDE(16)]);
}

// Return the inset with 5 m around the estimate; null while the vehicle is not near.
function near(here) {
  const { found, mean } = scene.search ?? {}, place = found?.place ?? mean;
  if (!place || view.width < 420 || view.scale > 15 || (!found && !(here && Math.hypot(here[0] - place[0], here[1] - place[1]) < 8))) return null;
  const size = Math.min(220, 0.4 * view.height, 0.3 * view.width);
  return { north: place[0], east: place[1], offsetLeft: view.width - size - 10, offsetTop: view.height - size - 10, offsetWidth: size, offsetHeight: size };
}

function drawInset({ north, east, offsetLeft: left, offsetTop: top, offsetWidth: size }, own, here) {
  const outer = names;
  names = new Names();
  eye = { width: size, height: size, scale: size / 10, north, east, x: (e) => size / 2 + (e - east) * size / 10, y: (n) => size / 2 - (n - north) * size / 10 };
  ink.save();
  ink.translate(left, top);
  ink.beginPath(); ink.rect(0, 0, size, size); ink.clip();
  ink.fillStyle = css("--ground"); ink.fill();
  drawGrid();
  if (own) drawTrack(own, true);
  drawSearch(scene.search);
  if (scene.truth) scene.transmitters.forEach(drawTransmitter);
  if (own && here && !own.ghost) drawVehicle(here, own, true);
  names.draw(ink, size, size);
  ink.strokeStyle = css("--ink"); ink.lineWidth = 3; ink.strokeRect(0, 0, size, size);
  label(ink, "10 m × 10 m", 8, 14, css("--ink"));
  ink.restore();
  [eye, names] = [view, outer];
}

function drawScale(right) {
  const metres = nice(110 / eye.scale), width = metres * eye.scale, x = 16, y = eye.height - 18;
  ink.strokeStyle = css("--ink");
  ink.lineWidth = 2;
  ink.lineCap = "butt";
  ink.beginPath();
  ink.moveTo(x, y - 6); ink.lineTo(x, y); ink.lineTo(x + width, y); ink.lineTo(x + width, y - 6);
  ink.stroke();
  label(ink, metres >= 1000 ? `${metres / 1000} km` : `${+metres.toPrecision(2)} m`, x + width / 2, y - 11, css("--ink"), FONT, "center");
  label(ink, scene.background?.about ?? "", x + width + 14, y, css("--ink"));
  const nx = right - 26, ny = eye.height - 34;
  ink.fillStyle = css("--ink");
  ink.beginPath();
  ink.moveTo(nx, ny - 14); ink.lineTo(nx + 7, ny + 8); ink.lineTo(nx, ny + 3); ink.lineTo(nx - 7, ny + 8); ink.closePath(); ink.fill();
  label(ink, "N", nx, ny + 19, css("--ink"), FONT, "center");
}

new ResizeObserver(ask).observe(canvas);
