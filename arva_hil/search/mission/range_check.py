"""Compares a rangefinder with the vehicle's motion: the ground cannot change where the vehicle does not fly."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

_WINDOW_S: Final = 2.0
_STEEPEST: Final = 1.0  # the steepest slope of the ground, except for steps within the tolerance
_SILENT_S: Final = 10.0  # after this time without a sample, lower ground is not accepted
_AT_REST_M_S: Final = 0.1  # below this speed the ground has no steps
_NOTED_S: Final = 3.0  # report a possible step for this time
_FORGET: Final = 0.2  # a step up, which may end with a step down, is forgotten at this rate: m per m of flight
_STUCK_M: Final = 0.5  # climb or descent with one repeated value: the rangefinder is stuck
_FOLLOWED: Final = 0.5  # largest slope that the vehicle follows, for which more climb is allowed
_SAME_M: Final = 1.0  # flight with one value after which the ground may have risen
_SAME_SLOPE: Final = 0.2  # slope of that ground
_DRIFT: Final = 0.05  # m/s; a faster drift is detected as a change of the ground
_DRIFTED_M: Final = 0.6  # possible drift before a check
_HOVER_M_S: Final = 0.3
_CHECK_S: Final = 4.0  # duration of a check in a hover
_SUNK_M: Final = 1.0  # climb or descent in that time: the vehicle does not hover
_STEADY_M: Final = 0.1  # largest change of a steady height in that time


class Odometry(NamedTuple):
    """The motion of the vehicle by its velocity."""

    time_s: float
    climbed: float
    """Climb since the start [m]."""
    flown: float
    """Length of the flight over ground since the start [m]."""
    speed: float
    """Speed over ground [m/s]."""
    place: tuple[float, float]
    """North and east [m]."""


class RangeCheck:
    """Remembers the ground and the error of the rangefinder. `tolerance`: of a change of the ground [m].

    `still`: the vehicle must hover, to check the rangefinder for drift.
    """

    def __init__(self, tolerance: float) -> None:
        self.still = False
        self._tolerance = tolerance
        self._past: deque[tuple[Odometry, float]] = deque()  # and the ground, above the place of the start [m]
        self._offset = 0.0  # sum of the steps that may be errors of the rangefinder; below 0: a step up
        self._flown = 0.0
        self._same: tuple[float, Odometry] | None = None  # the repeated sample, and the motion at its start
        self._noted: tuple[float, float, float] | None = None  # until when, value and expected value
        self._drifts: tuple[float, float] | None = None
        self._checked_s: float | None = None
        self._hover: tuple[Odometry, float] | None = None  # motion and height at the start of the hover

    def begin(self, motion: Odometry, ground: float) -> None:
        """Begin with known `ground` at the start [m above it]."""
        self._past.append((motion, ground))

    def deviation(self, now: float) -> tuple[float, float] | None:
        """Return the rangefinder's value that contradicts the motion, and the expected value [m]; None without one."""
        if self._noted is not None and now < self._noted[0]:
            return self._noted[1:]
        return self._drifts

    def height(self, motion: Odometry, metres: float, sample: float, confirmed: float) -> float | None:
        """Return the lowest height that may be true; None if the rangefinder is stuck.

        `metres`: as measured; `sample`: the rangefinder's last one; `confirmed`: the height above the highest ground,
        by the altitude.
        """
        if self._same is None or sample != self._same[0]:
            self._same = sample, motion
        since = self._same[1]
        climbed, flown = motion.climbed - since.climbed, motion.flown - since.flown
        if abs(climbed) >= _STUCK_M + _FOLLOWED * flown:
            self._contradict(motion, metres, metres + climbed, lasts=False)
            return None
        self._step(motion, metres)
        unseen = _SAME_SLOPE * max(0.0, flown - _SAME_M)
        return self._undrifted(motion, metres - max(0.0, self._offset), confirmed) - unseen

    def _step(self, motion: Odometry, metres: float) -> None:
        """Compare the ground with the previous one: a change that the flight does not explain is an error."""
        ground, past = motion.climbed - metres, self._past
        while len(past) > 1 and motion.time_s - past[0][0].time_s > _WINDOW_S:
            past.popleft()
        self._offset = min(max(self._offset, 0.0), self._offset + _FORGET * (motion.flown - self._flown))
        self._flown = motion.flown

        most = step = 0.0
        for before, was in past:
            known = motion.time_s - before.time_s <= _SILENT_S
            aside = math.dist(motion.place, before.place) if known else 0.0
            excess = abs(was - ground) - _STEEPEST * aside - self._tolerance
            if excess > most:
                most, step = excess, was - ground
        if most > 0:
            self._offset += step
            lasts = motion.speed < _AT_REST_M_S and abs(self._offset) > 2 * self._tolerance
            self._contradict(motion, metres, metres - step, lasts=lasts)
            past.clear()
        past.append((motion, ground))

    def _contradict(self, motion: Odometry, metres: float, expected: float, *, lasts: bool) -> None:
        self._noted = math.inf if lasts else motion.time_s + _NOTED_S, metres, expected

    def _undrifted(self, motion: Odometry, height: float, confirmed: float) -> float:
        """Return the height less the drift since the last check. Falling ground has the effect of a drift."""
        self._checked_s = motion.time_s if self._checked_s is None else self._checked_s
        drift = _DRIFT * (motion.time_s - self._checked_s)
        lowest = min(height, max(height - drift, confirmed))
        self.still = self.still or height - lowest > _DRIFTED_M
        if not self.still or motion.speed > _HOVER_M_S:
            self._hover = None
        elif self._hover is None or abs(motion.climbed - self._hover[0].climbed) > _SUNK_M:
            self._hover = motion, height
        elif motion.time_s - self._hover[0].time_s >= _CHECK_S:
            before, was = self._hover
            risen, self._hover = height - was, None
            drifts = min(abs(risen), abs(risen - motion.climbed + before.climbed)) > _STEADY_M
            self._drifts = (height, was) if drifts else None
            if not drifts:
                self._checked_s, self.still = motion.time_s, False
        return lowest
