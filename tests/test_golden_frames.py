"""The same flight, scenario and seed give the same bytes: in every version of this program.

`python -m tests.test_golden_frames` prints the sums, as they are in tests/data/frames.sha256. ARVA_HIL_FLIGHTS names
the folder of the whole flights. A change of a sum is a change of what the receiver says: its commit says why.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from arva_hil.cli.main import main

DATA: Final = Path(__file__).parent / "data"
CONFIGS: Final = Path(__file__).parents[1] / "configs"
SUMS: Final = DATA / "frames.sha256"
PIECES: Final = ("arducopter", "px4")
WHOLE_FOLDER: Final = Path(os.environ.get("ARVA_HIL_FLIGHTS", Path(__file__).parents[2] / "shared" / "data"))
BYTE_FAULTS: Final = ("truncate=0.2", "drop_bytes=0.01", "insert_bytes=0.01", "flip_bytes=0.01", "corrupt=0.1")
CASES: Final = {  # flight → scenario, format, seed: the pieces have each of them, the whole flights what comes later
    "arducopter": (
        ("default", "binary", 1),
        ("default", "binary", 2),
        ("default", "nmea", 1),
        ("default", "text", 1),
        ("default+bytes", "binary", 1),
        ("four_transmitters", "nmea", 1),
        ("faults", "nmea", 1),
        ("four_close", "text", 1),
    ),
    "px4": (
        ("default", "binary", 1),
        ("default+bytes", "nmea", 3),
        ("four_transmitters", "binary", 1),
        ("faults", "binary", 2),
        ("four_close", "binary", 1),
    ),
    "arducopter_square": (("faults", "binary", 1),),
    "px4_square": (("default", "binary", 1),),
}


def sums_of(flight: str, folder: Path) -> Iterator[tuple[str, str]]:
    """Every case's name and the SHA-256 of its frames."""
    out = folder / "frames"
    for scenario, format, seed in CASES[flight]:
        name, _, bytes_too = scenario.partition("+")
        faults = [word for fault in BYTE_FAULTS for word in ("--fault", fault)] if bytes_too else []
        words = ["--scenario", CONFIGS / f"{name}.yaml", "--format", format, "--seed", seed, *faults, "--out", out]
        assert main([str(word) for word in ["replay", log(flight), *words]]) == 0
        yield f"{flight} {scenario} {format} {seed}", hashlib.sha256(out.read_bytes()).hexdigest()


def log(flight: str) -> Path:
    return (DATA if flight in PIECES else WHOLE_FOLDER) / f"{flight}.tlog"


@pytest.mark.parametrize("flight", CASES)
def test_the_same_flight_scenario_and_seed_give_the_same_bytes(flight: str, tmp_path: Path) -> None:
    if not log(flight).exists():
        pytest.skip(f"{flight}.tlog is not part of the project: ARVA_HIL_FLIGHTS names its folder")
    lines = (line.split(" ", 1) for line in SUMS.read_text().splitlines())
    kept = {name: sum for sum, name in lines if name.startswith(f"{flight} ")}
    assert dict(sums_of(flight, tmp_path)) == kept


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        for flight in CASES:
            for name, sum in sums_of(flight, Path(scratch)):
                print(sum, name)
