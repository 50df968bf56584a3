"""What a vehicle does if it gets no orders, in words. It follows from the vehicle's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

_RADIO_STATION: Final = ("FS_THR_ENABLE", "FS_GCS_ENABLE"), ("NAV_RCL_ACT", "NAV_DLL_ACT")  # ArduPilot's, PX4's
_FS: Final = {
    0: "nothing",
    1: "RTL",
    2: "RTL",
    3: "SmartRTL or RTL",
    4: "SmartRTL or LAND",
    5: "LAND",
    6: "the mission's landing or RTL",
    7: "BRAKE or LAND",
}
_FS_THR: Final = _FS | {3: "LAND", 4: "SmartRTL or RTL", 5: "SmartRTL or LAND"}
_IN_GUIDED: Final = 4  # of FS_OPTIONS: without a radio it goes on in GUIDED
_OFFBOARD_LOST: Final = {
    0: "goes to Position mode",
    1: "goes to Altitude mode",
    2: "goes to Stabilized mode",
    3: "returns",
    4: "lands",
    5: "holds",
    6: "terminates",
    7: "disarms",
}
_PX4_LOST: Final = {0: "nothing", 1: "Hold", 2: "Return", 3: "Land", 5: "termination", 6: "disarming"}


def left_alone(values: Mapping[str, float], px4: bool) -> str:
    """What the vehicle does in GUIDED or Offboard mode if no set-points come."""
    if not px4:
        after = _after(values, "GUID_TIMEOUT", "s")
        return f"it stops{after}, and hovers in GUIDED, armed, until somebody takes control"
    act, after = _word(values, "COM_OBL_RC_ACT", _OFFBOARD_LOST), _after(values, "COM_OF_LOSS_T", "s")
    return f"it {act}{after}" if act else f"its action is unknown{after}: it did not report COM_OBL_RC_ACT"


def failsafes(values: Mapping[str, float], px4: bool) -> str:
    """What the vehicle does without set-points, without a radio and without a ground station."""
    radio, station = _RADIO_STATION[px4]
    without = _word(values, radio, _PX4_LOST if px4 else _FS_THR) or f"unknown ({radio})"
    if int(values.get("FS_OPTIONS", 0)) & _IN_GUIDED:
        without = f"nothing in GUIDED (FS_OPTIONS {values['FS_OPTIONS']:g})"
    ground = _word(values, station, _PX4_LOST if px4 else _FS) or f"unknown ({station})"
    alone = f"without set-points {left_alone(values, px4)}"
    return f"{alone}; without a radio: {without}; without a ground station: {ground}"


def _word(values: Mapping[str, float], name: str, words: Mapping[int, str]) -> str:
    """What a parameter's value means, and the parameter; "" if the vehicle did not report it."""
    value = values.get(name)
    return "" if value is None else f"{words.get(int(value), 'an unknown action')} ({name} {value:g})"


def _after(values: Mapping[str, float], name: str, unit: str) -> str:
    value = values.get(name)
    return f" after an unknown time ({name})" if value is None else f" after {value:g} {unit} ({name})"
