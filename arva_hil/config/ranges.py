"""Ranges that options of commands and keys of files share. Importing this imports nothing else."""

from typing import Final

FRAMES_HZ: Final = (0.1, 50)  # from, to
LARGEST_SEED: Final = 2**63 - 1
