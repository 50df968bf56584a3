"""Where the scenario's origin lies."""

from __future__ import annotations

from typing import Final

from arva_hil.autopilot.session import Session
from arva_hil.model import LocalFrame
from arva_hil.scenario import Scenario

HOME_WAIT_S: Final = 5.0  # for HOME_POSITION, before the first valid position serves


class Datum:
    """Remembers where the scenario's origin lies.

    A fixed one stays. `home` is the vehicle's home and follows it until the vehicle arms, because autopilots move
    it by a metre while they settle; from then on it stays. Without a HOME_POSITION the first valid position serves
    after 5 s, and gives way to a home only on the ground: transmitters do not jump in flight.
    """

    def __init__(self, scenario: Scenario) -> None:
        fixed = scenario.datum
        self.lla: tuple[float, float, float] | None = None  # degrees, degrees, metres AMSL
        self._provisional = False
        self._latched = fixed != "home"
        self._first_position_at: float | None = None
        self.frame: LocalFrame | None = None
        if fixed != "home":
            self._set((fixed.lat, fixed.lon, fixed.alt))

    def update(self, session: Session, now: float) -> bool:
        """Look again; True when the datum has changed."""
        if self._latched:
            return False
        home = session.home
        if home is None:
            first = session.track.first_position
            if first is None:  # not yet, or not since a reboot
                self._first_position_at = None
            if self.frame is not None or first is None:
                return False
            if self._first_position_at is None:
                self._first_position_at = now
            if now - self._first_position_at < HOME_WAIT_S:
                return False
            home = (first.lat, first.lon, first.alt)
            self._provisional = True
        else:
            self._latched = session.vehicle is not None and session.vehicle.armed
            if self._latched and self._provisional:
                return False
            self._provisional = False
        if home == self.lla:
            return False
        self._set(home)
        return True

    def __str__(self) -> str:
        return "unknown" if self.lla is None else "{:.7f}, {:.7f}, {:.2f} m AMSL".format(*self.lla)

    def _set(self, home: tuple[float, float, float]) -> None:
        self.lla = home
        self.frame = LocalFrame(*home)
