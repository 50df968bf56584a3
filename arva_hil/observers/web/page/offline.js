// Answers the requests of the page from the data in its own file: a record without a server.

import { T } from "./store.js";

const packed = Uint8Array.from(atob(document.getElementById("record").textContent), (c) => c.charCodeAt(0));
const data = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
let last = {}, field = 0;
const moments = data.moments.map((changes) => (last = { ...last, ...changes }));

globalThis.offline = (name) => {
  if (name.startsWith("field")) return data.fields.find((one) => one.version === field);
  if (name.startsWith("timeline")) return data.timeline;
  const query = new URLSearchParams(name.split("?")[1]), [first, end] = last.span, wanted = Number.parseFloat(query.get("at"));
  const at = Number.isNaN(wanted) ? end : Math.min(end, Math.max(first, wanted)), version = 1 + Math.round(at * 1000);
  const now = moments.findLast((one) => one.at <= at) ?? moments[0], same = Number(query.get("since")) === version;
  field = now.field;
  const receivers = now.receivers.map((one, i) => {
    const points = data.readings[i].filter((point) => point[T] <= at), all = data.readings[i].length;
    return { ...one, points: same ? [] : points, frames: Math.round((last.receivers[i].frames * points.length) / Math.max(1, all)) };
  });
  const events = same ? [] : data.timeline.events.filter(([time]) => time <= at).slice(-200);
  return { ...now, at, version, time_s: at, events, receivers, full: !same, all_events: !same };
};
