"""Receivers: the protocol of receiver models, readings, and the paper's receiver."""

from arva_hil.model.field.rotation import Pose

from .paper import Antennas, NoiseKind, PaperReceiver, outputs
from .reading import ChannelReading, PulseReading, Reading, Zone, with_true_ranges
from .receiver_model import Answer, Impairment, Look, ReceiverModel, ReceiverSettings

__all__ = ["Answer", "Antennas", "ChannelReading", "Impairment", "Look", "NoiseKind", "PaperReceiver", "Pose"]
__all__ += ["PulseReading", "Reading", "ReceiverModel", "ReceiverSettings", "Zone", "outputs", "with_true_ranges"]
