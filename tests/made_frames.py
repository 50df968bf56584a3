"""Frames as an engine makes them, without one."""

from __future__ import annotations

from typing import Any

from arva_hil.emulator.receivers import frame_of
from arva_hil.events import FrameMade
from arva_hil.model.receiver import ChannelReading, Pose, Reading


def frame_made(
    number: int,
    *channels: ChannelReading,
    instant_s: float | None = None,
    pose: Pose | None = None,
    of: tuple[str, str] = ("vehicle", "receiver"),
    late_s: float = 0.0,
    **fields: Any,
) -> FrameMade:
    """Frame `number`, by default of one a second, with the reading of these channels. `of`: vehicle and receiver."""
    reading, instant_s = Reading(channels, False, False), float(number) if instant_s is None else instant_s
    usual = {"time_s": instant_s + late_s, "boot_s": None, "age_s": None, "sent": True}
    usual |= {"vehicle": of[0], "receiver": of[1], "frame": frame_of(reading, number % 256)} | fields
    return FrameMade(number=number, instant_s=instant_s, pose=pose, reading=reading, late_s=late_s, **usual)
