"""The record of a real receiver beside a real autopilot, live or from bytes that were kept."""

from .kept_bytes import KeptBytes, play
from .receiver_log import AUTOPILOT, RECEIVER, ReceivedFrames, ReceiverLog, Surveyed, surveyed_scenario

__all__ = [
    "AUTOPILOT",
    "RECEIVER",
    "KeptBytes",
    "ReceivedFrames",
    "ReceiverLog",
    "Surveyed",
    "play",
    "surveyed_scenario",
]
