"""Words and ranges of a scenario that commands offer as options too. Importing this imports nothing else."""

from __future__ import annotations

from typing import Final, Literal, get_args

Format = Literal["binary", "nmea", "text", "tunnel", "named", "named_float", "debug_vect"]

FORMATS: Final[tuple[Format, ...]] = get_args(Format)
WIRE_FORMATS: Final = ("binary", "nmea", "text")  # the others go over the autopilot's own link
FRAMES_HZ: Final = (0.1, 50)  # from, to
LARGEST_SEED: Final = 2**63 - 1
