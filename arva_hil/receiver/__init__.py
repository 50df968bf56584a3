"""Receivers: the protocol of receiver models, readings, and the paper's receiver."""

from .paper import Antennas, NoiseKind, PaperReceiver, outputs
from .reading import ChannelReading, Reading, Zone, with_true_ranges
from .receiver_model import Answer, Look, Pose, ReceiverModel, ReceiverSettings

__all__ = [
    "Answer",
    "Antennas",
    "ChannelReading",
    "Look",
    "NoiseKind",
    "PaperReceiver",
    "Pose",
    "Reading",
    "ReceiverModel",
    "ReceiverSettings",
    "Zone",
    "outputs",
    "with_true_ranges",
]
