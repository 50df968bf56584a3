"""Draws README's moving picture of the demo: the page and the terminal's lines at the same times of one flight.

python tools/demo_film.py [--out docs/pictures/demo.gif]    # needs Chromium, and Playwright for Python
"""

from __future__ import annotations

import argparse
import io
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from PIL import Image
from playwright.sync_api import sync_playwright

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent.parent))

from tools.demo_picture import terminal

SIZE_PX: Final = (1280, 660)  # of the page
WIDTH_PX: Final = 840
STEP_S: Final = 1.5  # of the flight, from picture to picture
SHOWN_MS: Final = 180
LAST_MS: Final = 4000
LINES: Final = 6
PALETTE: Final = 128  # colours of the file
ARVA_HIL: Final = [sys.executable, "-m", "arva_hil"]


def flight(folder: Path) -> tuple[float, list[tuple[float, str]]]:
    """Fly the demo and record it into a folder; return its length in seconds, and its messages with their times."""
    subprocess.run([*ARVA_HIL, "demo", "--speed", "max", "--record", str(folder)], capture_output=True, check=True)
    said, last = [], 0.0
    for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines():
        event = json.loads(line)
        last = max(last, float(event.get("time_s", 0.0)))
        if notice := event.get("notice"):
            said.append((float(event["time_s"]), str(notice["text"])))
    return last, said


def pages(folder: Path, times: list[float]) -> Iterator[Image.Image]:
    """Yield the page with the record at each of these times."""
    command = [*ARVA_HIL, "view", str(folder), "--web", "127.0.0.1:0"]
    viewer = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert viewer.stderr is not None
        address = next(found[0] for line in viewer.stderr if (found := re.search(r"http://\S+", line)))
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": SIZE_PX[0], "height": SIZE_PX[1]})
            page.goto(address)
            page.wait_for_selector("html[data-ready=true]")
            for time_s in times:
                page.locator("#slider").evaluate(
                    "(one, time) => { one.value = time; one.dispatchEvent(new Event('input')); }", time_s
                )
                page.wait_for_timeout(700)
                yield Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            browser.close()
    finally:
        viewer.terminate()
        viewer.wait()


def side_by_side(pictures: list[Image.Image]) -> Image.Image:
    """Return all pictures in one, which has the colours of all."""
    width, height = pictures[0].size
    whole = Image.new("RGB", (width * len(pictures), height))
    for n, one in enumerate(pictures):
        whole.paste(one, (n * width, 0))
    return whole


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/pictures/demo.gif"), help="default %(default)s")
    out: Path = parser.parse_args().out
    with tempfile.TemporaryDirectory() as folder:
        end, said = flight(Path(folder) / "record")
        times = [STEP_S * n for n in range(1, int(end / STEP_S))] + [end]
        pictures = []
        for time_s, page in zip(times, pages(Path(folder) / "record", times), strict=True):
            now = [text[:88] for at, text in said if at <= time_s][-LINES:]
            small = page.resize((WIDTH_PX, WIDTH_PX * page.height // page.width), Image.Resampling.LANCZOS)
            below = terminal(["$ arva-hil demo", *now, *[""] * (LINES - len(now))], WIDTH_PX)
            whole = Image.new("RGB", (WIDTH_PX, small.height + below.height))
            whole.paste(small, (0, 0))
            whole.paste(below, (0, small.height))
            pictures.append(whole)
    colours = side_by_side(pictures[::5]).quantize(PALETTE, dither=Image.Dither.NONE)
    first, *rest = [one.quantize(palette=colours, dither=Image.Dither.NONE) for one in pictures]
    shown = [SHOWN_MS] * len(rest) + [LAST_MS]
    first.save(out, save_all=True, append_images=rest, duration=shown, loop=0, optimize=True)
    print(f"{out}: {len(pictures)} pictures, {out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
