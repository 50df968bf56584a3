"""The rows of a record's tables: one for each slot of a reading in readings.csv, one for each frame in frames.csv.

An unknown value is an empty cell. Numbers have full precision. The names of faults are the only texts.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from arva_hil.events import FrameMade
from arva_hil.field import rotation
from arva_hil.runtime.clock import utc
from arva_hil.safe_text import cell

COLUMNS: Final = (
    "seq time_s boot_ms north_m east_m down_m roll_deg pitch_deg yaw_deg pose_age_ms "
    "slot id zone d_cm delta_deg true_range_m faults reported_north_m reported_east_m reported_down_m "
    "late_ms"
).split()
FRAME_COLUMNS: Final = "utc time_s seq north_m east_m down_m roll_deg pitch_deg yaw_deg".split()
SLOT_COLUMNS: Final = ("id{}", "zone{}", "d{}_cm", "delta{}_deg", "range{}_m")  # of each slot, from 1

_NO_SLOT: Final = "," * (len(SLOT_COLUMNS) - 1)


def header_of_frames(slots: int) -> str:
    """The first line of frames.csv."""
    of_slots = [column.format(slot) for slot in range(1, slots + 1) for column in SLOT_COLUMNS]
    return ",".join([*FRAME_COLUMNS, *of_slots]) + "\n"


def rows(made: FrameMade, columns: int) -> tuple[str, str]:
    """The lines of readings.csv, and the line of frames.csv without its `utc`, so it begins with a comma.

    `columns`: the number of slots in frames.csv, which stays if a command changes the receiver's.
    """
    pose = ",".join(_pose(made))
    number, instant_s = str(made.frame.sequence), repr(made.instant_s)
    boot_ms = "" if made.boot_s is None else repr(made.boot_s * 1e3)
    age_ms = "" if made.age_s is None else repr(made.age_s * 1e3)
    reported = "," * 2 if made.reported_pose is None else ",".join(map(repr, made.reported_pose.position.tolist()))
    faults = cell("+".join(made.faults)) if made.faults else ""
    head = f"{number},{instant_s},{boot_ms},{pose},{age_ms}"
    tail = f"{faults},{reported},{made.late_s * 1e3!r}"
    slots = []
    for c in made.reading.channels:
        id_, true_range = ("" if value is None else repr(value) for value in (c.id, c.true_range_m))
        slots.append(f"{id_},{int(c.zone)},{c.d_cm},{c.delta_deg},{true_range}")
    lines = [f"{head},{number_of_slot},{slot},{tail}\n" for number_of_slot, slot in enumerate(slots, 1)]
    of_frame = (slots + [_NO_SLOT] * columns)[:columns]
    return "".join(lines), ",".join(["", instant_s, number, pose, *of_frame]) + "\n"


def moment(time_s: float, epoch_us: int) -> str:
    """A time of the loop in UTC, to the millisecond; "" outside the years 1 to 9999, which a log may contain.

    `epoch_us`: microseconds since 1970 at the loop's time 0.
    """
    try:
        return utc(epoch_us + round(time_s * 1e6))
    except (ValueError, OverflowError, OSError):
        return ""


def _pose(made: FrameMade) -> list[str]:
    if made.pose is None:
        return [""] * 6
    angles = np.degrees(rotation.to_euler(made.pose.rotation)).tolist()
    return [repr(value) for value in (*made.pose.position.tolist(), *angles)]
