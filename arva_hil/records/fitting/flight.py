"""One recorded flight for a fit: the vehicle's track, and the readings of one or more transmitters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.autopilot.following.session import Session
from arva_hil.config import Scenario
from arva_hil.emulator.setup import one_vehicle
from arva_hil.emulator.world import VehicleWorld
from arva_hil.errors import ArvaError
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.records.comparing.again import feed
from arva_hil.records.reading import NO_ID, Recording

Floats = NDArray[np.float64]

TRACK_S: Final = 0.1  # between two poses of the track
MOST: Final = 450  # readings; more of them are thinned
LEAST: Final = 25
MOST_GAP_S: Final = 1.0  # in the track, at a reading

_LOOK_AHEAD_S: Final = 1.0


class FitError(ArvaError):
    """A record cannot be fitted. `str()` says what is missing."""


@dataclass(frozen=True)
class RecordedFlight:
    """The readings of a flight, NED from its datum.

    - `time_s` (N,): time of each reading's frame. `who` (N,): index into `ids`.
    - `d_m`, `delta` [rad] (N,): δ is NaN in the inner zone and for receivers of one antenna.
    - `inner` (N,): True if the third antenna counts.
    - `track_s` (T,), `track` (T, 3), `attitude` (T, 4): the vehicle's poses; neighbours have quaternions of one sign.
    - `heard_until_m`: the largest d if the transmitter was lost beyond it; otherwise None.
    - `near_m`: the largest d of the inner zone; None without one.
    - `places`: surveyed places by id.
    """

    name: str
    ids: tuple[int, ...]
    time_s: Floats
    who: NDArray[np.intp]
    d_m: Floats
    delta: Floats
    inner: NDArray[np.bool_]
    track_s: Floats
    track: Floats
    attitude: Floats
    heard_until_m: float | None
    near_m: float | None
    d_step: tuple[float, float]
    """Step of d below and above 10 m [m]."""
    delta_step: float
    """Step of δ [rad]."""
    places: dict[int, Floats]
    frame_s: float
    """Time between two frames."""
    repeated: float
    """Share of frames that repeat the reading before, though the vehicle moves."""

    def __len__(self) -> int:
        return len(self.time_s)

    def part(self, keep: NDArray[Any]) -> RecordedFlight:
        """Return some of the readings. `keep`: True for them, or their numbers."""
        return replace(
            self,
            time_s=self.time_s[keep],
            who=self.who[keep],
            d_m=self.d_m[keep],
            delta=self.delta[keep],
            inner=self.inner[keep],
        )

    def poses(self, latency_s: float) -> tuple[Floats, Floats]:
        """Return positions (N, 3) and rotations body → NED (N, 3, 3), `latency_s` before the frames of the readings."""
        at = np.clip(self.time_s - latency_s, self.track_s[0], self.track_s[-1])
        after = np.clip(np.searchsorted(self.track_s, at), 1, len(self.track_s) - 1)
        before_s, after_s = self.track_s[after - 1], self.track_s[after]
        share = ((at - before_s) / (after_s - before_s))[:, None]
        position = (1 - share) * self.track[after - 1] + share * self.track[after]
        q = (1 - share) * self.attitude[after - 1] + share * self.attitude[after]
        return position, rotation.to_matrix(q)


def flight_of(recording: Recording) -> RecordedFlight:
    """Return the flight of a record. Raises FitError and RecordingError."""
    if len(recording.receivers) != 1:
        raise FitError(f"{recording.folder}: expected a record of one receiver, found {len(recording.receivers)}")
    (receiver,) = recording.receivers
    if not len(receiver):
        raise FitError(f"{recording.folder}: poses without frames: there is no reading to fit")
    ids = receiver.ids or ((NO_ID,) if (receiver.zone > 0).any() else ())
    if not ids:
        raise FitError(f"{recording.folder}: no frame contains a transmitter: was it on, and is the format right?")
    track_s, track, attitude, frame = _track(recording)
    after = np.clip(np.searchsorted(track_s, receiver.time_s), 1, len(track_s) - 1)
    gaps = np.minimum(np.abs(track_s[after] - receiver.time_s), np.abs(track_s[after - 1] - receiver.time_s))
    rows = []
    for index, id_ in enumerate(ids):
        d_m, delta, zone, _ = receiver.of_transmitter(id_)
        use = (zone > 0) & (d_m > 0) & (gaps <= MOST_GAP_S)
        rows.append((receiver.time_s[use], np.full(use.sum(), index), d_m[use], delta[use], zone[use] == 2))
    time_s, who, d_m, delta, inner = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    if not len(time_s):
        raise FitError(f"{recording.folder}: frames without poses: the autopilot's packets do not cover the readings")
    if len(time_s) < LEAST:
        found = f"{len(time_s)} readings with a pose, at least {LEAST} are needed"
        raise FitError(f"{recording.folder}: too short: {found}; fly a pass in each direction, a minute at 1 Hz")
    order = np.argsort(time_s, kind="stable")
    heard = receiver.nearest_zone > 0
    lost = heard.any() and not heard[np.isfinite(receiver.position).all(axis=1)].all()
    frame_s = float(np.median(np.diff(receiver.time_s))) if len(receiver) > 1 else 1.0
    flight = RecordedFlight(
        str(recording.folder),
        ids,
        time_s[order],
        who[order].astype(np.intp),
        d_m[order],
        np.radians(delta[order]),
        inner[order],
        track_s,
        track,
        attitude,
        float(d_m.max()) if lost else None,
        float(d_m[inner].max()) if inner.any() else None,
        (_step(d_m[d_m < 10]), _step(d_m[d_m >= 10])),
        _delta_step(delta),
        _places(recording, frame),
        frame_s,
        _repeated(d_m[order], delta[order], who[order]),
    )
    return thinned(flight, MOST)


def thinned(flight: RecordedFlight, most: int) -> RecordedFlight:
    """Return at most so many readings, evenly over the flight."""
    if len(flight) <= most:
        return flight
    return flight.part(np.linspace(0, len(flight) - 1, most).round().astype(int))


def _track(recording: Recording) -> tuple[Floats, Floats, Floats, LocalFrame]:
    """Return times, positions and attitudes that the vehicle reported, and the frame of its datum."""
    setup = one_vehicle(Scenario((), source=str(recording.folder)), Session(passive=True))
    world = VehicleWorld(setup, {}, start=0.0, max_age_s=MOST_GAP_S)
    seen: list[tuple[float, VehicleState]] = []
    due = -5.0

    def settle(now: float) -> None:
        nonlocal due
        while due <= now and (now - due >= _LOOK_AHEAD_S or world.is_known(due)):
            if (pose := world.at(due).pose) is not None:
                seen.append((due, pose))
            due += TRACK_S

    settle(feed(recording, setup, world, settle) + _LOOK_AHEAD_S)
    if not seen or world.datum.frame is None:
        raise FitError(f"{recording.folder}: frames without poses: the autopilot sent no position, attitude and home")
    times, poses = zip(*seen, strict=True)
    quaternions = np.array([pose.attitude for pose in poses])
    return np.array(times), np.array([p.position for p in poses]), with_near_signs(quaternions), world.datum.frame


def with_near_signs(quaternions: Floats) -> Floats:
    """Return the same rotations (T, 4), each with the sign nearer to the previous one, for interpolation."""
    turned = np.sign((quaternions[1:] * quaternions[:-1]).sum(axis=1))
    signs = np.cumprod(np.where(turned == 0, 1, turned))
    return np.vstack([quaternions[:1], quaternions[1:] * signs[:, None]])


def _places(recording: Recording, frame: LocalFrame) -> dict[int, Floats]:
    """Return the surveyed places of a record of a real receiver, NED."""
    run = recording.run
    if run is None or not run.is_real or run.scenario is None:
        return {}
    every = [(t.id, t.lla) for t in run.scenario.transmitters if t.lla is not None]
    return {id_: np.asarray(frame.ned(lla.lat, lla.lon, lla.alt), float) for id_, lla in every}


def _step(d_m: Floats) -> float:
    """Return the step in which d is shown."""
    cm = np.unique(np.round(100 * d_m).astype(int))
    return float(np.gcd.reduce(cm)) / 100 if len(cm) > 3 else 0.01


def _delta_step(delta_deg: Floats) -> float:
    """Return the step of δ [rad]: arrows, or whole degrees."""
    values = np.unique(delta_deg[np.isfinite(delta_deg)])
    few = 2 < len(values) <= 24 and np.isfinite(delta_deg).sum() > 5 * len(values)
    return float(np.radians(np.median(np.diff(values)) if few else 1.0))


def _repeated(d_m: Floats, delta_deg: Floats, who: NDArray[np.intp]) -> float:
    if len(d_m) < 2:
        return 0.0
    same = (np.diff(d_m) == 0) & (np.nan_to_num(np.diff(delta_deg)) == 0) & (np.diff(who) == 0)
    return float(same.mean())
