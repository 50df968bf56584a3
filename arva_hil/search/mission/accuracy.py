"""The accuracy of the autopilot's position on Earth: its report, and a floor for a slow drift that it cannot detect.

Messages, https://mavlink.io/en/messages/common.html: GPS_RAW_INT.h_acc and eph, ESTIMATOR_STATUS.pos_horiz_accuracy.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from arva_hil.autopilot.following.session import Received, Session
from arva_hil.mavlink.codec import dialect
from arva_hil.search.strategies.strategy import Covariance, Found

_GPS: Final = dialect.MAVLINK_MSG_ID_GPS_RAW_INT
_ESTIMATOR: Final = dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS
_FLOOR_M: Final = 2.1  # sigma on each axis without corrections, an assumption: makers of boards name 2.5 m CEP
# With corrections. DGPS and float: assumptions. RTK fixed: 0.01 m + 1 ppm CEP (u-blox ZED-F9P, UBX-18010802, 2.1.2).
_FLOORS_M: Final = {
    dialect.GPS_FIX_TYPE_DGPS: 1.7,
    dialect.GPS_FIX_TYPE_RTK_FLOAT: 0.5,
    dialect.GPS_FIX_TYPE_RTK_FIXED: 0.01,
}
_RECENT: Final = 0.07  # share of the error that changes near a place, if the strategy follows no drift
_UNKNOWN: Final = 0xFFFF  # unknown eph


class Accuracy(NamedTuple):
    """The accuracy of a position on Earth: sigma on each horizontal axis [m]."""

    sigma_m: float = _FLOOR_M
    """At least the floor."""
    reported: bool = False
    """True if the autopilot reports an accuracy."""

    @property
    def reported_m(self) -> float | None:
        """The sigma; None if the autopilot does not report an accuracy."""
        return self.sigma_m if self.reported else None

    def on_earth(self, found: Found) -> Covariance | None:
        """Return the covariance of the position on Earth of a place found [m²]; None if none is known."""
        return _with(found.covariance, self.sigma_m)

    def relative(self, found: Found) -> Covariance | None:
        """Return the covariance of the place relative to the drone [m²]; None if none is known."""
        return found.now_covariance or _with(found.covariance, _RECENT * self.sigma_m)


def _with(covariance: Covariance | None, sigma_m: float) -> Covariance | None:
    if covariance is None:
        return None
    nn, ne, ee = covariance
    return nn + sigma_m**2, ne, ee + sigma_m**2


UNKNOWN: Final = Accuracy()


class PositionAccuracy:
    """Remembers the worst values since the vehicle was armed."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._worst: dict[int, Accuracy] = {}  # by message

    @property
    def worst(self) -> Accuracy:
        """The worst accuracy of this flight."""
        gps, estimator = self._worst.get(_GPS, UNKNOWN), self._worst.get(_ESTIMATOR)
        if estimator is None:
            return gps
        return Accuracy(max(gps.sigma_m, estimator.sigma_m), True)

    def on_packets(self, received: Received) -> None:
        """Use what the session received."""
        armed = self._session.vehicle is not None and self._session.vehicle.armed
        for msgid, message in received.messages((_GPS, _ESTIMATOR)):
            if (new := _by_gps(message) if msgid == _GPS else _by_estimator(message)) is None:
                continue
            before = self._worst.get(msgid, new) if armed else new
            self._worst[msgid] = Accuracy(max(new.sigma_m, before.sigma_m), new.reported and before.reported)


def _by_gps(message: Any) -> Accuracy:
    """Return the accuracy of the GPS. 0 is unknown; the floor grows with the dilution of precision."""
    reported = message.h_acc > 0
    floor = _FLOORS_M.get(message.fix_type, _FLOOR_M) if reported else _FLOOR_M
    dilution = message.eph / 100 if 0 < message.eph < _UNKNOWN else 1.0
    return Accuracy(max(message.h_acc / 1e3, floor * max(1.0, dilution)), reported)


def _by_estimator(message: Any) -> Accuracy | None:
    sigma_m = message.pos_horiz_accuracy
    return Accuracy(sigma_m, True) if 0 < sigma_m < math.inf else None
