"""The physics: poses and transmitters in, readings out. NED, metres, radians; numpy and nothing else."""

from .field import Transmitters, dipole_field
from .geodesy import LocalFrame
from .reading import ChannelReading, Reading, Zone, with_true_ranges
from .receiver import Antennas, NoiseKind, Receiver, outputs

__all__ = [
    "Antennas",
    "ChannelReading",
    "LocalFrame",
    "NoiseKind",
    "Reading",
    "Receiver",
    "Transmitters",
    "Zone",
    "dipole_field",
    "outputs",
    "with_true_ranges",
]
