"""The physics: poses and transmitters in, readings out. NED, metres, radians; numpy and nothing else."""

from .field import Transmitters, dipole_field
from .geodesy import LocalFrame
from .motion import Following, MovingTransmitters, Waypoints
from .mount import Mount
from .reading import ChannelReading, Reading, Zone, with_true_ranges
from .receiver import Antennas, NoiseKind, PaperReceiver, outputs
from .receiver_model import Answer, Look, Pose, ReceiverModel

__all__ = [
    "Answer",
    "Antennas",
    "ChannelReading",
    "Following",
    "LocalFrame",
    "Look",
    "Mount",
    "MovingTransmitters",
    "NoiseKind",
    "PaperReceiver",
    "Pose",
    "Reading",
    "ReceiverModel",
    "Transmitters",
    "Waypoints",
    "Zone",
    "dipole_field",
    "outputs",
    "with_true_ranges",
]
