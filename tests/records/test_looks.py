"""Transmitters look the same everywhere, and no two of 42 alike, whatever colours an eye can tell apart."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from arva_hil.records.pictures.style import LOOKS, SHAPES, look_of

PAGE = Path(__file__).parents[2] / "arva_hil/observers/web/page"
DIFFERENT = 15.0  # CIEDE2000: "just noticed" is 1
SIMULATED = {  # G. Machado, M. Oliveira, L. Fernandes, 2009: severity 1.0, of linear RGB
    "normal": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]])


def linear(colour: str) -> NDArray[np.float64]:
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    x = XYZ @ np.clip(rgb, 0, 1) / [0.95047, 1, 1.08883]
    f = np.where(x > 216 / 24389, np.cbrt(x), (24389 / 27 * x + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def difference(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """CIEDE2000 (G. Sharma, W. Wu, E. Dalal, 2005)."""
    (l1, a1, b1), (l2, a2, b2) = one, other
    mean = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    g = 1.5 - 0.5 * np.sqrt(mean**7 / (mean**7 + 25**7))
    c1, c2 = np.hypot(g * a1, b1), np.hypot(g * a2, b2)
    h1, h2 = np.degrees(np.arctan2(b1, g * a1)) % 360, np.degrees(np.arctan2(b2, g * a2)) % 360
    dh = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0.0
    hue = np.radians((h1 + dh / 2) % 360)
    lm, cm = (l1 + l2) / 2, (c1 + c2) / 2
    t = 1 - 0.17 * np.cos(hue - np.radians(30)) + 0.24 * np.cos(2 * hue)
    t += 0.32 * np.cos(3 * hue + np.radians(6)) - 0.2 * np.cos(4 * hue - np.radians(63))
    dl = (l2 - l1) / (1 + 0.015 * (lm - 50) ** 2 / np.sqrt(20 + (lm - 50) ** 2))
    dc = (c2 - c1) / (1 + 0.045 * cm)
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(dh) / 2) / (1 + 0.015 * cm * t)
    turn = -2 * np.sqrt(cm**7 / (cm**7 + 25**7))
    turn *= np.sin(np.radians(60 * np.exp(-(((np.degrees(hue) - 275) / 25) ** 2))))
    return float(np.sqrt(dl**2 + dc**2 + dh**2 + turn * dc * dh))


def palettes() -> list[list[str]]:
    """Those of the page: light, dark, and the receiver's display."""
    css = (PAGE / "style.css").read_text()
    return [re.findall("#[0-9a-f]{6}", colours) for colours in re.findall(r"(?:--c\d: #[0-9a-f]{6}; ?){6}", css)]


def test_the_measure_is_that_of_its_authors() -> None:
    pairs = [((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425), ((50, 2.5, 0), (73, 25, -18), 27.1492)]
    for one, other, expected in pairs:
        assert difference(np.array(one), np.array(other)) == pytest.approx(expected, abs=1e-4)


def test_pictures_and_page_have_the_same_colours_and_as_many_shapes() -> None:
    light, dark, display = palettes()
    assert light == list(LOOKS)
    assert dark == display
    assert (PAGE / "store.js").read_text().split("SHAPES = [")[1].split("]")[0].count('"M') == len(SHAPES)


@pytest.mark.parametrize("sight", SIMULATED)
@pytest.mark.parametrize("at", [0, 1])
def test_no_two_of_42_look_alike(sight: str, at: int) -> None:
    colours = {c: lab(np.array(SIMULATED[sight]) @ linear(c)) for c in palettes()[at]}
    apart = {pair: difference(*(colours[c] for c in pair)) for pair in itertools.combinations(colours, 2)}
    assert min(apart.values()) >= DIFFERENT, min(apart.items(), key=lambda pair: pair[1])
    looks = [look_of(id_) for id_ in range(len(LOOKS) * len(SHAPES))]
    assert len(set(looks)) == 42
    assert all(a[0] != b[0] and a[1] != b[1] for a, b in itertools.pairwise(looks))
