"""Records for tests: what the recorder and the search's log write of a flight that was made up."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from arva_hil.config import DEFAULT, Scenario, parse, to_dict
from arva_hil.emulator.build import receiver, transmitters
from arva_hil.emulator.receivers import frame_of
from arva_hil.events import DatumSet, FrameMade, PoseFound, PoseLost, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.reasons import NoPose
from arva_hil.events.searches import FromSearch, PlaceFound, TakeOffPoint, TransmitterHeard
from arva_hil.model.field import LocalFrame
from arva_hil.model.field.rotation import from_euler, to_matrix
from arva_hil.model.receiver import Look, Pose
from arva_hil.records.writing import Recorder, RecordLayout
from arva_hil.records.writing.search_log import SearchLog
from arva_hil.search.mission.outcome import SearchStep

HOME = (46.0123, 7.7456, 1650.0)
EPOCH_US = 1_798_761_600_000_000  # 2027-01-01T00:00:00Z
START_S = 2.0  # the frames begin so long after the program
SILENT = 3  # the first frames have no pose


def pose_at(time_s: float) -> Pose:
    """Flies north-east at 1 m/s, 3 m high, heading 30°."""
    north, east = 0.9 * time_s, 0.3 * time_s
    return Pose(np.array([north, east, -3.0]), to_matrix(from_euler(0.01, -0.02, math.radians(30))))


def frames(
    scenario: Scenario, count: int, names: tuple[str, str] = ("vehicle", "receiver"), silent: int = SILENT
) -> list[FrameMade]:
    """So many frames, the first ones without a pose, every 7th hit by a fault, made up to 4 ms too late."""
    model, there = receiver(scenario), transmitters(scenario, LocalFrame(*HOME))
    made = []
    for n in range(count):
        time_s, pose = n / scenario.receiver.rate_hz, None
        if n >= silent:
            pose = pose_at(time_s)
        model.look(Look(time_s, pose, there))
        reading, late_s = model.show(time_s), 0.001 * (n % 5)
        made.append(
            FrameMade(
                START_S + time_s + late_s,
                *names,
                n,
                time_s,
                None if pose is None else 10.0 + time_s,
                pose,
                None if pose is None else 0.004,
                reading,
                frame_of(reading, n % 256),
                True,
                late_s,
                ("stuck", "drop") if n % 7 == 6 else (),
                pose,
            )
        )
    return made


def write(
    folder: Path,
    count: int = 30,
    scenario: Scenario = DEFAULT,
    *,
    ended: bool = True,
    search: bool = True,
    receivers: Sequence[tuple[str, str]] = (),
    epoch_us: int = EPOCH_US,
) -> Path:
    """Write a record of so many frames of each receiver. `ended`: it was not killed."""
    about: dict[str, Any] = {
        "started": "2027-01-01T00:00:00.000Z",
        "scenario": to_dict(scenario),
        "scenario_source": "flight <1>.yaml",
        "seed": scenario.seed,
        "versions": {"arva-hil": "0.1.0", "python": "3.11.7"},
    }
    recorder = Recorder(folder, epoch_us, about, patient=True, layout=RecordLayout(tuple(receivers)))
    names = list(receivers) if len(receivers) > 1 else [("vehicle", "receiver")]
    recorder.observe(DatumSet(START_S, names[0][0], *HOME, ()))
    for of in names:
        for made in frames(scenario, count, of):
            recorder.observe(made)
            status = ReceiverStatus(of[1], made, made.number + 1, 0)
            rates = {"ATTITUDE": 50.0, "GLOBAL_POSITION_INT": 49.5}
            recorder.observe(StatusReport(made.time_s, [VehicleStatus(of[0], "quadrotor 1/1", rates, [status])]))
    recorder.observe(PoseFound(START_S + SILENT, *names[0]))
    recorder.observe(FromSearch(START_S + 5, TransmitterHeard(START_S + 5, 1, 19.0, 0.5, 0.5)))
    recorder.observe(PoseLost(START_S + count, *names[0], 2.5, NoPose("streams stopped", (), "")))
    datums = [{"time_s": 0.0, "lat_lon_alt": HOME, "why": ""}]
    vehicle = {"datum": HOME, "datums": datums, "vehicle": {"system": 1, "component": 1, "autopilot": 3}}
    counters = {
        "frames": count,
        "delivered": count,
        "dropped": 0,
        "latest_s": 0.004,
        "faults": {"stuck": {"frames": 4}},
    }
    if len(names) > 1:
        every = {name: {**vehicle, "counters": {}, "receivers": {}} for name, _ in names}
        recorder.close({"ended": "finished", "exit_code": 0, **about, "vehicles": every, "counters": counters})
    elif ended:
        recorder.close({"ended": "finished", "exit_code": 0, **about, **vehicle, "counters": counters})
    else:
        recorder.close({"ended": None, "exit_code": None, **about})
    if search:
        write_search(folder, count, ended=ended)
    return folder


def write_several(folder: Path, count: int, receivers: Sequence[tuple[str, str]]) -> Path:
    """The record of vehicles with a receiver each, and of two transmitters."""
    every = enumerate(receivers, 1)
    vehicles = [f"{{name: {name}, system: {n}, receivers: [{{name: {one}}}]}}" for n, (name, one) in every]
    places = "transmitters: [{id: 1, ned: [20, 5, 0]}, {id: 2, ned: [30, 5, 0]}]"
    scenario = parse(f"spec: 2\n{places}\nvehicles: [{', '.join(vehicles)}]\noutput: {{format: tunnel}}\n", "x")
    return write(folder, count, scenario, search=False, receivers=receivers)


TAKE_OFF: Final = [float(value) for value in LocalFrame(*HOME).lla([2.0, 0.0, 0.0])]
TEAM: Final = (("drone-1", "receiver"), ("drone-2", "receiver"))


def write_team(folder: Path, count: int = 30, *, code: int = 0) -> Path:
    """The record of a demo of two drones: the first has found transmitter 1, and the second searches until the end."""
    write_several(folder, count, TEAM)
    run = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps(run | {"ended": "SIGINT" if code else "finished", "exit_code": code}))
    place = {"transmitter": 1, "north_m": 18.5, "east_m": 5.25, "sure": True, "earth_covariance": [4.0, 0.0, 4.0]}
    events: list[dict[str, Any]] = [
        {"event": "take_off_point", "time_s": 4.0, **dict(zip(("lat", "lon", "alt"), TAKE_OFF, strict=True))},
        {"event": "search_begun", "time_s": 5.0, "height_m": 3.0, "wanted": 1},
        {"event": "place_found", "time_s": 9.0, **place},
        {"event": "search_ended", "time_s": 9.5, "how": "found", "landing": True},
    ]
    news = [{**event, "by": "search", "of": of} for of, _ in TEAM for event in events[: 4 if of == "drone-1" else 2]]
    with open(folder / "events.jsonl", "a") as file:
        file.writelines(json.dumps(event) + "\n" for event in news)
    return folder


def write_search(folder: Path, count: int = 30, *, ended: bool = True, **outcome: Any) -> Path:
    """The log of a search that took off 2 m north of the datum, one second after the frames began."""
    log = SearchLog(folder, start_s=0.0)
    for n in range(count):
        heard = (1, 1900 - 20 * n, 12, 1) if n % 5 == 0 else (None, None, None, None)
        phase = "climbing" if n < 5 else "flying" if n < count - 5 else "landing"
        log.row(SearchStep(0.2 * n, phase, 0.2 * n, 0.1 * n, -3.0, 30.0, 0.9, 0.3, 0.0, *heard))
    place = [float(value) for value in LocalFrame(*HOME).lla([20.5, 5.25, 0.0])]
    spread = [0.16, 0.03, 0.04]
    found = {"north": 18.5, "east": 5.25, "down": 0.0, "lat_lon": place[:2], "autopilot_sigma_m": 0.1}
    found |= {"covariance": spread, "earth_covariance": spread}
    said = {"started": "2027-01-01T00:00:03.000Z", "outcome": "found", "how": "found", "id": 1, "found": found}
    said |= {"origin": TAKE_OFF, "time_s": 21.5, "path_m": 22.0, "frames": 30, "others": []}
    log.observe(TakeOffPoint(0.0, *TAKE_OFF))
    if outcome.get("found", found):
        log.observe(
            PlaceFound(0.2 * (count - 6), 1, 18.5, 5.25, (0.16, 0.03, 0.04), True, None, (0.16, 0.03, 0.04), 0.1)
        )
    log.close(said | outcome)
    if not ended:
        (folder / "search.json").unlink()
    return folder
