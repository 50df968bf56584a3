"""Compares the page of a record in Chromium with the record's own files, at random moments.

python -m tools bench page RECORD [--moments 500] [--seed 1]
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from arva_hil.cli.view import serve
from arva_hil.observers.web.address import HostPort
from arva_hil.observers.web.viewer import RecordedState
from arva_hil.records.reading import RecordedReceiver, load
from arva_hil.records.reading.recording import NO_ID
from tests.browser import ARGUMENTS, CHROMIUM

READ = """([time, reading]) => {
  const text = (id) => document.getElementById(id).textContent;
  if (Math.abs(Number(document.getElementById("number").dataset.time) - reading) > 0.0006 || Math.abs(Number(document.getElementById("slider").value) - time) > 0.006) return null;
  const rows = [...document.querySelectorAll("#channels tbody tr")].map((row) => [...row.cells].map((cell) => cell.textContent));
  return { rows, distance: text("distance"), heard: text("heard"), number: text("number"), map: document.getElementById("map").getAttribute("aria-label") };
}"""  # noqa: E501
GO = """(time) => {
  const slider = document.getElementById("slider");
  slider.value = time;
  slider.dispatchEvent(new Event("input"));
}"""
ZONES = ("–", "mid", "inner")


def metres(cm: int) -> str:
    return f"{cm / 100:.{1 if cm >= 1000 else 2}f}"


def expected(receiver: RecordedReceiver, i: int) -> dict[str, Any]:
    """Return what the display says of reading `i`; true ranges are compared apart."""
    slots = receiver.rows(i)
    columns = (receiver.id, receiver.zone, receiver.d_cm, receiver.delta_deg)
    rows = []
    for id_, zone, d, delta in zip(*(column[slots].tolist() for column in columns), strict=True):
        direction = f"{'−' if delta < 0 else '+'}{abs(delta)}°" if zone == 1 else "–"
        rows.append(
            [str(id_) if id_ != NO_ID else "?", f"{metres(d)} m", direction, ZONES[zone]] if d > 0 else ["–"] * 4
        )
    near = [int(d) for d in receiver.d_cm[slots] if d > 0]
    return {
        "rows": rows,
        "distance": metres(min(near)) if near else "––",
        "heard": str(len(near)),
        "number": str(i + 1),
    }


def wrong(shown: dict[str, Any], receiver: RecordedReceiver, i: int) -> list[str]:
    """Return the differences of the page to reading `i`."""
    wanted = expected(receiver, i)
    found = [
        f"{key}: {shown[key]!r}, not {wanted[key]!r}"
        for key in ("distance", "heard", "number")
        if shown[key] != wanted[key]
    ]
    if [row[:4] for row in shown["rows"]] != wanted["rows"]:
        found.append(f"channels: {shown['rows']}, not {wanted['rows']}")
    for row, true in zip(shown["rows"], receiver.true_range_m[receiver.rows(i)].tolist(), strict=True):
        if row[4] != "–" and not abs(float(row[4].removesuffix(" m")) - true) <= 0.011:
            found.append(f"true range: {row[4]}, not {true}")
    north, east = receiver.position[i, :2].tolist()
    if math.isfinite(north):
        place = f"vehicle at {abs(north):.1f} m {'south' if round(north, 1) < 0 else 'north'}, {abs(east):.1f} m"
        if place not in shown["map"] and not any(abs(10 * abs(x) % 1 - 0.5) < 0.01 for x in (north, east)):
            found.append(f"map: {shown['map']!r}, not {place!r}")
    return found


def wrong_outcome(page: Any, folder: Path) -> list[str]:
    """Return the differences of the outcome's card to search.json."""
    said = json.loads((folder / "search.json").read_text())
    places = [one["lat_lon"] for one in said.get("victims") or [said["found"]]]
    shown = [[float(x) for x in text.split(",")] for text in page.locator("#outcome code").all_inner_texts()]
    same = len(places) == len(shown) and np.allclose(sorted(places), sorted(shown), rtol=0, atol=1.1e-7)
    return [] if same else [f"places: {shown}, not {places}"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("record", type=Path)
    parser.add_argument("--moments", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    recording = load(options.record)
    receiver = recording.receivers[0]
    server = serve(HostPort("127.0.0.1", 0), RecordedState(recording))
    chance = random.Random(options.seed)
    found: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1280, "height": 720}, reduced_motion="reduce")
        start = time.monotonic()
        page.goto(server.address.url)
        page.wait_for_selector("html[data-ready=true]")
        ready_s = time.monotonic() - start
        found += wrong_outcome(page, options.record)
        for _ in range(options.moments):
            time_s = round(chance.uniform(max(0.0, float(receiver.time_s[0])), recording.span_s[1]), 2)
            i = int(np.searchsorted(receiver.time_s, time_s, side="right")) - 1
            page.evaluate(GO, time_s)
            shown = page.wait_for_function(READ, arg=[time_s, float(receiver.time_s[i])]).json_value()
            found += [f"{time_s} s: {what}" for what in wrong(shown, receiver, i)]
        heap_mb = page.evaluate("performance.memory.usedJSHeapSize") / 1e6
        browser.close()
    server.close()
    print(f"ready in {ready_s:.2f} s, heap of the page {heap_mb:.1f} MB")
    print(*found, f"{options.moments} moments and the outcome: {len(found)} wrong", sep="\n")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
