"""Readings of one flight side by side: of a real receiver and the emulator, or of two records."""

from .again import Emulated, NotComparable, Paired, emulated_again, paired_frames
from .comparison import TOO_FEW, Comparison, Spread, compared

__all__ = [
    "TOO_FEW",
    "Comparison",
    "Emulated",
    "NotComparable",
    "Paired",
    "Spread",
    "compared",
    "emulated_again",
    "paired_frames",
]
