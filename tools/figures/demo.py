"""Draws README's picture of the demo, or its moving one: the page and the terminal's lines at the same times.

python -m tools figures demo            # docs/pictures/demo.png: the terminal, and the search's own picture
python -m tools figures demo --film     # docs/pictures/demo.gif; needs Chromium, and Playwright for Python
"""

from __future__ import annotations

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

from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from tools.options import parser

PICTURES: Final = Path(__file__).parents[2] / "docs" / "pictures"
ARVA_HIL: Final = [sys.executable, "-m", "arva_hil"]
COLUMNS: Final = 92
EDGE_PX: Final = 14
PAPER, INK, DIM, BRIGHT = "#14181f", "#d6dbe3", "#8b95a5", "#f0c674"


def demo(folder: Path) -> list[str]:
    """Fly the demo and record it into a folder; return its output."""
    command = [*ARVA_HIL, "demo", "--speed", "max", "--record", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stderr.splitlines()


def shown(lines: list[str]) -> list[str]:
    """Return the lines for the picture: without places of this machine, and not longer than the terminal."""
    kept = [line for line in lines if "/" not in line or "quadrotor" in line]
    return ["$ arva-hil demo", *(line if len(line) <= COLUMNS else line[: COLUMNS - 1] + "…" for line in kept)]


def terminal(lines: list[str], width: int) -> Image.Image:
    """Return the picture of a terminal of this width in pixels with these lines."""
    path = font_manager.findfont("DejaVu Sans Mono")
    size = next(
        s for s in range(20, 6, -1) if ImageFont.truetype(path, s).getlength("0" * COLUMNS) <= width - 2 * EDGE_PX
    )
    font, line_px = ImageFont.truetype(path, size), size + 3
    image = Image.new("RGB", (width, line_px * len(lines) + 2 * EDGE_PX), PAPER)
    draw = ImageDraw.Draw(image)
    for i, line in enumerate(lines):
        bright = line.startswith(("$", "found", "search: found", "error of "))
        colour = BRIGHT if bright else DIM if line.startswith(("scenario", "  ", "datum")) else INK
        draw.text((EDGE_PX, EDGE_PX + i * line_px), line, fill=colour, font=font)
    return image


def stacked(above: Image.Image, below: Image.Image) -> Image.Image:
    whole = Image.new("RGB", (above.width, above.height + below.height), "white")
    whole.paste(above, (0, 0))
    whole.paste(below.convert("RGB"), (0, above.height))
    return whole


SIZE_PX: Final = (1280, 660)  # of the page
WIDTH_PX: Final = 840
STEP_S: Final = 1.5  # of the flight, from picture to picture
SHOWN_MS: Final = 180
LAST_MS: Final = 4000
LINES: Final = 6


def flight(folder: Path) -> tuple[float, list[tuple[float, str]]]:
    """Fly the demo and record it into a folder; return its length in seconds, and its messages with their times."""
    demo(folder)
    said, last = [], 0.0
    for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines():
        event = json.loads(line)
        last = max(last, float(event.get("time_s", 0.0)))
        if notice := event.get("notice"):
            said.append((float(event["time_s"]), str(notice["text"])))
    return last, said


def pages(folder: Path, times: list[float]) -> Iterator[Image.Image]:
    """Yield the page with the record at each of these times."""
    from playwright.sync_api import sync_playwright

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


def film(out: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        end, said = flight(Path(folder) / "record")
        times = [STEP_S * n for n in range(1, int(end / STEP_S))] + [end]
        pictures = []
        for time_s, page in zip(times, pages(Path(folder) / "record", times), strict=True):
            now = [text[:88] for at, text in said if at <= time_s][-LINES:]
            small = page.resize((WIDTH_PX, WIDTH_PX * page.height // page.width), Image.Resampling.LANCZOS)
            below = terminal(["$ arva-hil demo", *now, *[""] * (LINES - len(now))], WIDTH_PX)
            pictures.append(stacked(small, below))
    colours = side_by_side([*pictures[::5], pictures[-1]]).quantize(256, Image.Quantize.MAXCOVERAGE)
    first, *rest = [one.quantize(palette=colours, dither=Image.Dither.NONE) for one in pictures]
    shown = [SHOWN_MS] * len(rest) + [LAST_MS]
    first.save(out, save_all=True, append_images=rest, duration=shown, loop=0, optimize=True)
    print(f"{out}: {len(pictures)} pictures, {out.stat().st_size / 1e3:.0f} kB")


def main() -> None:
    if parser(__doc__, film=(False, "draw the moving picture")).parse_args().film:
        film(PICTURES / "demo.gif")
        return
    with tempfile.TemporaryDirectory() as folder:
        lines = demo(Path(folder) / "record")
        with Image.open(Path(folder) / "record/search.png") as search:
            stacked(terminal(shown(lines), search.width), search).save(PICTURES / "demo.png", optimize=True)
