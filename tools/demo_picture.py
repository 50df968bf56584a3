"""Draws README's picture of the demo: the terminal, and the search's own picture, of a run made for it.

python tools/demo_picture.py [--out docs/pictures/demo.png]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

COLUMNS: Final = 92
LINE_PX: Final = 17
EDGE_PX: Final = 14
PAPER, INK, DIM, BRIGHT = "#14181f", "#d6dbe3", "#8b95a5", "#f0c674"
PALETTE: Final = 64  # colours of the file: what keeps it small


def demo(folder: Path) -> list[str]:
    """Fly the demo and record it into a folder; return its output."""
    command = [sys.executable, "-m", "arva_hil", "demo", "--speed", "max", "--record", str(folder)]
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
    font = ImageFont.truetype(path, size)
    image = Image.new("RGB", (width, LINE_PX * len(lines) + 2 * EDGE_PX), PAPER)
    draw = ImageDraw.Draw(image)
    for i, line in enumerate(lines):
        bright = line.startswith(("$", "found", "search: found", "error of "))
        colour = BRIGHT if bright else DIM if line.startswith(("scenario", "  ", "datum")) else INK
        draw.text((EDGE_PX, EDGE_PX + i * LINE_PX), line, fill=colour, font=font)
    return image


def picture(lines: list[str], search: Image.Image) -> Image.Image:
    """Return the terminal above the search's picture."""
    above = terminal(lines, search.width)
    whole = Image.new("RGB", (search.width, above.height + search.height), "white")
    whole.paste(above, (0, 0))
    whole.paste(search.convert("RGB"), (0, above.height))
    return whole.quantize(PALETTE, dither=Image.Dither.NONE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, default=Path("docs/pictures/demo.png"), help="default docs/pictures/demo.png"
    )
    out: Path = parser.parse_args().out
    with tempfile.TemporaryDirectory() as folder:
        lines = demo(Path(folder) / "record")
        with Image.open(Path(folder) / "record/search.png") as search:
            picture(shown(lines), search).save(out, optimize=True)


if __name__ == "__main__":
    main()
