"""The same flight, scenario and seed give the same bytes: in every version of this program.

`python -m tests.test_golden_frames FOLDER` prints the sums of the flights in FOLDER and of the pieces in tests/data,
as they are in tests/data/frames.sha256. A change of a sum is a change of what the receiver says: its commit says why.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Final

import pytest

from arva_hil.cli.main import main

DATA: Final = Path(__file__).parent / "data"
CONFIGS: Final = Path(__file__).parents[1] / "configs"
SUMS: Final = DATA / "frames.sha256"
PIECES: Final = ("arducopter", "px4")
WHOLE: Final = ("arducopter_square", "px4_square")
WHOLE_FOLDER: Final = Path(os.environ.get("ARVA_HIL_FLIGHTS", Path(__file__).parents[2] / "shared" / "data"))
SCENARIOS: Final = ("default", "four_transmitters", "faults", "four_close")
FORMATS: Final = ("binary", "nmea", "text")
SEEDS: Final = (1, 2, 3)
BYTE_FAULTS: Final = ("truncate=0.2", "drop_bytes=0.01", "insert_bytes=0.01", "flip_bytes=0.01", "corrupt=0.1")


def flown(flight: str, scenario: str, format: str, seed: int) -> bool:
    """Whether the tests replay this case: with the first seed or the first format, a whole flight with both or in the
    first scenario.
    """
    first = (seed == SEEDS[0]) + (format == FORMATS[0])
    return first == 2 or (first == 1 and flight in PIECES) or (seed == SEEDS[0] and scenario == SCENARIOS[0])


def sums_of(flight: Path, scenario: str, folder: Path, *, every: bool = True) -> Iterator[tuple[str, str]]:
    """Every case's name and the SHA-256 of its frames; those alone that the tests replay if it is not `every`."""
    faults = [word for fault in BYTE_FAULTS for word in ("--fault", fault)]
    formats = FORMATS[:-1] if scenario == "faults" else FORMATS  # text has no status bits to set
    extra: dict[str, list[str]] = {"": [], "+bytes": faults} if scenario == "default" else {"": []}
    for format, seed, (more, options) in product(formats, SEEDS, extra.items()):
        if not (every or flown(flight.stem, scenario, format, seed)):
            continue
        out = folder / "frames"
        words = ["replay", flight, "--scenario", CONFIGS / f"{scenario}.yaml", "--format", format, "--seed", seed]
        assert main([str(word) for word in [*words, *options, "--out", out]]) == 0
        yield f"{flight.stem} {scenario}{more} {format} {seed}", hashlib.sha256(out.read_bytes()).hexdigest()


def kept() -> dict[str, str]:
    lines = (line.split(" ", 1) for line in SUMS.read_text().splitlines())
    return {name: sum for sum, name in lines}


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("flight", [*PIECES, *WHOLE])
def test_the_same_flight_scenario_and_seed_give_the_same_bytes(flight: str, scenario: str, tmp_path: Path) -> None:
    path = (WHOLE_FOLDER if flight in WHOLE else DATA) / f"{flight}.tlog"
    if not path.exists():
        pytest.skip(f"{path.name} is not part of the project: ARVA_HIL_FLIGHTS names its folder")
    made = dict(sums_of(path, scenario, tmp_path, every=False))
    expected = kept()
    assert made == {name: expected[name] for name in made}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        for flight in [*(DATA / f"{name}.tlog" for name in PIECES), *(Path(sys.argv[1]) / f"{n}.tlog" for n in WHOLE)]:
            for scenario in SCENARIOS:
                for name, sum in sums_of(flight, scenario, Path(scratch)):
                    print(sum, name)
