// Plots over time: d and the true range, the age of the pose, the lateness of frames. No signal is a gap.

import { AGE, CM, ID, LATE, RANGE, SLOTS, T, clock, colourOf, css, el } from "./store.js";

const MOST_IDS = 6, MOST_POINTS = 1600; // a screen has no more pixels
const SECONDS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400];
const $ = (id) => document.getElementById(id);
let plots = [], layout = "", span = 0;

export function setSpan(seconds) { span = seconds; }
export function forgetPlots() { plots.forEach((plot) => plot.chart.destroy()); plots = []; layout = ""; $("plots").replaceChildren(); }

function idsOf(points) {
  const known = new Set();
  for (const point of points) {
    for (const slot of point[SLOTS]) if (slot[CM] > 0) known.add(slot[ID]);
    if (known.size >= MOST_IDS) break;
  }
  return [...known].sort((a, b) => a - b);
}

// Return the true range of a transmitter in a reading; of a single transmitter an empty slot has it too.
function rangeOf(slots, id, alone) {
  for (const slot of slots) if (slot[ID] === id) return slot[RANGE];
  return alone && slots.length ? slots[0][RANGE] : null;
}

// `alone`: there is one transmitter.
export function showPlots(points, truth, alone) {
  let shown = points;
  if (span && points.length) {
    const from = points[points.length - 1][T] - span;
    shown = points.slice(points.findIndex((point) => point[T] >= from));
  }
  if (shown.length > MOST_POINTS) {
    const step = Math.ceil(shown.length / MOST_POINTS), newest = shown.length - 1;
    shown = shown.filter((_, i) => (newest - i) % step === 0);
  }
  const ids = idsOf(points), t = shown.map((point) => point[T]);
  const ranged = truth && shown.some((point) => point[SLOTS].some((slot) => slot[RANGE] !== null));
  const aged = points.some((point) => point[AGE] !== null), late = points.some((point) => point[LATE]);
  const wanted = JSON.stringify([ids, ranged, aged, late]);
  if (wanted !== layout) {
    forgetPlots();
    layout = wanted;
    const series = ids.map((id) => ({ label: id === null ? "d" : `d of ${id}`, colour: colourOf(id), dots: true }));
    if (ranged) series.push(...ids.map((id) => ({ label: id === null ? "true range" : `true range of ${id}`, colour: colourOf(id), dashed: true })));
    add("Distance", "m", 190, series);
    if (aged) add("Age of the pose", "ms", 110, [{ label: "age", colour: css("--track") }]);
    if (late) add("Lateness of frames", "ms", 110, [{ label: "late", colour: css("--warn") }]);
  }
  const d = ids.map((id) => shown.map((point) => {
    for (const slot of point[SLOTS]) if (slot[ID] === id && slot[CM] > 0) return slot[CM] / 100;
    return null;
  }));
  const ranges = ranged ? ids.map((id) => shown.map((point) => rangeOf(point[SLOTS], id, alone))) : [];
  const data = [[t, ...d, ...ranges]];
  if (aged) data.push([t, shown.map((point) => point[AGE])]);
  if (late) data.push([t, shown.map((point) => point[LATE])]);
  plots.forEach((plot, i) => {
    plot.chart.setData(data[i]);
    plot.holder.dataset.points = t.length;
  });
}

function add(title, unit, height, series) {
  const keys = series.map((one) => {
    const line = el("i", one.dashed ? { class: "dashed" } : {});
    line.style.borderColor = one.colour;
    return el("span", {}, line, one.label);
  });
  const holder = el("div", { class: "plot" }, el("h3", {}, `${title} [${unit}]`, ...(series.length > 1 || series[0]?.dots ? keys : [])));
  $("plots").append(holder);
  const axis = { stroke: css("--soft"), grid: { stroke: css("--grid"), width: 1 }, ticks: { stroke: css("--grid"), size: 4 }, font: "12px system-ui" };
  const chart = new uPlot({
    width: holder.clientWidth || 600, height, legend: { show: false },
    cursor: { sync: { key: "time" }, drag: { x: false, y: false }, points: { size: 6 } },
    scales: { x: { time: false }, y: { range: (_, low, high) => [Math.min(0, low ?? 0), Math.max(high ?? 1, 1e-3) * 1.08] } },
    axes: [
      { ...axis, size: 30, incrs: SECONDS, values: (_, ticks) => ticks.map(clock) },
      { ...axis, size: 48 },
    ],
    series: [{}, ...series.map((one) => ({
      stroke: one.colour, width: one.dashed ? 1.5 : 2, dash: one.dashed ? [6, 5] : undefined,
      points: { show: one.dots ? undefined : false, size: 4 },
    }))],
  }, [[0], ...series.map(() => [null])], holder);
  plots.push({ chart, holder, height });
}

new ResizeObserver(() => {
  for (const { chart, holder, height } of plots) {
    if (holder.clientWidth && holder.clientWidth !== chart.width) chart.setSize({ width: holder.clientWidth, height });
  }
}).observe($("plots"));
