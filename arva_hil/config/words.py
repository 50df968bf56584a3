"""Ranges of a scenario that commands offer as options too. Importing this imports nothing else."""

from __future__ import annotations

from typing import Final

FRAMES_HZ: Final = (0.1, 50)  # from, to
LARGEST_SEED: Final = 2**63 - 1
