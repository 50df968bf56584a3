"""The record of a real receiver beside a real autopilot, live or from bytes that were kept."""

from .kept_bytes import KeptBytes, play
from .receiver_log import AUTOPILOT, RECEIVER, ReceiverLog
from .surveyed import Surveyed, surveyed_scenario

__all__ = ["AUTOPILOT", "RECEIVER", "KeptBytes", "ReceiverLog", "Surveyed", "play", "surveyed_scenario"]
