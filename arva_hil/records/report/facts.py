"""The facts of a run, as labels and values under headings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.config import Scenario
from arva_hil.events.reasons import Why, because
from arva_hil.events.words.reasons import in_words
from arva_hil.events.words.text import in_metres, placed, unless_reported
from arva_hil.records.reading import RecordedPlace, RecordedReceiver, Recording, mapping, number, objects, streams, text
from arva_hil.safe_text import one_line
from arva_hil.search.strategies.strategy import sigma_of

Facts = Mapping[str, Mapping[str, str]]  # heading → label → value

_MOST_STREAMS: Final = 8
_MOST_IDS: Final = 8
_MOST: Final = 200  # values of one kind
_NOT_ENDED: Final = "not: it goes on, or was killed"


def facts(recording: Recording) -> Facts:
    """Return all known facts of a run. Raises RecordingError for a log of packets that cannot be read."""
    found: dict[str, dict[str, str]] = {}
    if recording.searches:
        found["What the search found"] = dict(_search(recording))
    found["What was run"] = dict(_run(recording))
    for receiver in recording.receivers:
        of = f" of {receiver.name}" if receiver.name else ""
        found[f"Frames{of}"] = dict(_frames(receiver))
    for vehicle in dict.fromkeys(receiver.vehicle for receiver in recording.receivers):
        of = f" of {vehicle}" if vehicle else ""
        rates = {one.name: f"{one.mean_hz:.3g} Hz" for one in streams(recording, vehicle)[:_MOST_STREAMS]}
        found[f"Rates of the streams{of}"] = rates
    if recording.run:
        found["Faults"] = dict(_faults(recording))
        found["Counters"] = dict(_counters(recording.run.json))
    return {heading: rows for heading, rows in found.items() if rows}


def _run(recording: Recording) -> Iterator[tuple[str, str]]:
    run = recording.run
    begin_s, end_s = recording.span_s
    if run is not None:
        how = run.json.get("ended")
        yield "ended", _NOT_ENDED if how is None else one_line(f"{how} (exit code {run.json.get('exit_code')})")
        yield "started", one_line(run.started)
    yield "length", f"{end_s - begin_s:.1f} s"
    if run is None:
        return
    if run.is_real:
        yield "receiver", one_line(f"a real one at {run.json.get('receiver')}, format {run.json.get('format')}")
    else:
        yield "scenario", one_line(run.json.get("scenario_source", ""))
    if run.scenario:
        yield from _scenario(run.scenario, real=run.is_real)
    if (seed := number(run.json.get("seed"))) is not None:
        yield "seed", str(int(seed))
    labels = [text(event.get("label")) for event in recording.events if event.get("event") == "vehicle_found"]
    found = dict.fromkeys(one_line(label) for label in labels if label)
    yield "autopilot", ", ".join(list(found)[:_MOST]) or "none was found"
    command = run.json.get("command")
    if isinstance(command, list):
        yield "command", one_line(" ".join(map(str, command[:_MOST])))
    versions = _first(mapping(run.json.get("versions")))
    yield "versions", one_line(", ".join(f"{name} {value}" for name, value in versions))


def _scenario(scenario: Scenario, *, real: bool) -> Iterator[tuple[str, str]]:
    for transmitter in scenario.transmitters[:_MOST_IDS]:
        where = "moving"
        if transmitter.ned is not None:
            north, east, down = transmitter.ned
            where = f"{north:g} m north, {east:g} m east, {down:g} m down of the datum"
        elif transmitter.lla is not None:
            where = f"{transmitter.lla.lat:.7f}, {transmitter.lla.lon:.7f}, {transmitter.lla.alt:g} m AMSL"
        strength = "" if real else f"; strength {transmitter.strength:g}"
        yield f"transmitter {transmitter.id}", where + strength
    if real:
        return
    receiver = scenario.receiver
    yield (
        "receiver",
        f"{receiver.model}, {receiver.rate_hz:g} Hz, {receiver.channels} slots, noise {receiver.noise.kind}",
    )
    yield "format", scenario.output_format
    if scenario.faults:
        yield "faults planned", "; ".join(str(fault) for fault in scenario.faults[:_MOST])


def _search(recording: Recording) -> Iterator[tuple[str, str]]:
    for vehicle, search in recording.searches.items():
        yield f"{_by(vehicle)}ended", one_line(search.how) or _NOT_ENDED
    places, errors = _places(recording), errors_m(recording)
    if places:
        yield "found", found_of(recording)
    for index, (vehicle, found) in enumerate(places[:_MOST]):
        of = f" of victim {index + 1}" if len(places) > 1 else ""
        yield from ((_by(vehicle) + label + of, value) for label, value in _place(found, errors.get(index)))
    for id_ in missed(recording)[:_MOST]:
        yield f"transmitter {id_}", "not found"
    said = recording.search.outcome if recording.search else {}
    for label, name, form in (
        ("time", "time_s", "{:.0f} s"),
        ("path", "path_m", "{:.0f} m"),
        ("frames", "frames", "{:g}"),
    ):
        if (value := number(said.get(name))) is not None:
            yield label, form.format(value)
    for other in objects(said.get("others"))[:_MOST_IDS]:
        if (nearest := number(other.get("nearest_m"))) is not None:
            yield f"received, not found: {one_line(other.get('id'))}", f"{nearest:.1f} m away at the nearest"


def _by(vehicle: str) -> str:
    """Return the begin of a label: the drone of a team."""
    return one_line(f"{vehicle}: ") if vehicle else ""


def _places(recording: Recording) -> list[tuple[str, RecordedPlace]]:
    """Return all places found, with the name of their search."""
    return [(name, place) for name, search in recording.searches.items() for place in search.places]


def _place(found: RecordedPlace, error: float | None) -> Iterator[tuple[str, str]]:
    who = "" if found.id is None else f"transmitter {found.id}: "
    doubt = "" if found.sure else f"; {in_words(because(Why.NOT_SURE))}"
    yield "place", f"{who}{placed(found.north, found.east)} of the take-off point{doubt}"
    if found.lat_lon:
        yield "latitude, longitude", f"{found.lat_lon[0]:.7f}, {found.lat_lon[1]:.7f}"
    if ellipse := found.ellipse():
        major, minor, bearing = ellipse
        angle = math.degrees(bearing) % 180
        inside = f"{in_metres(major)} × {in_metres(minor)}, long axis {angle:.0f}°"
        yield "on Earth, 95 % inside", inside + unless_reported(found.autopilot_sigma_m)
    else:
        yield "on Earth, 95 % inside", "the strategy does not say how sure it is"
    if (spread := sigma_of(found.relative_covariance)) is not None:
        yield "relative to the drone", f"± {in_metres(spread)}"
    if error is not None:
        yield "error", f"{in_metres(error)} from the transmitter, horizontally"


def _frames(receiver: RecordedReceiver) -> Iterator[tuple[str, str]]:
    count = len(receiver)
    yield "frames", str(count)
    if not count:
        return
    span_s = float(receiver.time_s[-1] - receiver.time_s[0])
    if count > 1 and span_s > 0:
        yield "rate", f"{(count - 1) / span_s:.3g} Hz"
    yield "lateness", _percentiles(receiver.late_ms)
    yield "age of the pose", _percentiles(receiver.pose_age_ms)
    blind = int((~np.isfinite(receiver.position).all(axis=1)).sum())
    yield "without a pose", f"{blind} ({blind / count:.1%})"
    for id_ in receiver.ids[:_MOST_IDS]:
        d_m, _, zone, range_m = receiver.of_transmitter(id_)
        off = d_m - range_m
        off = off[np.isfinite(off)]
        words = f"in {(zone > 0).mean():.1%} of the frames"
        if len(off):
            words += (
                f"; d − true range: median {np.median(off):+.2f} m, 90 % within {np.percentile(abs(off), 90):.2f} m"
            )
        yield f"transmitter {id_} heard", words


def _percentiles(times_ms: NDArray[np.float64]) -> str:
    """Return median, 90 %, 99 % and worst."""
    known = times_ms[np.isfinite(times_ms)]
    if not len(known):
        return "not recorded"
    return " / ".join(_plain(value, 3) for value in np.percentile(known, [50, 90, 99, 100])) + " ms"


def _faults(recording: Recording) -> Iterator[tuple[str, str]]:
    for receiver in recording.receivers:
        of = f"{receiver.name}: " if receiver.name else ""
        for name in receiver.faults[:_MOST]:
            struck = int(receiver.with_fault(name).sum())
            yield of + one_line(name), f"{struck} frames ({struck / len(receiver):.1%})"


def _counters(said: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the counters that are not 0, those of vehicles and receivers with their names."""
    groups = [("", said.get("counters"))]
    for vehicle, of_vehicle in _first(said.get("vehicles")):
        groups.append((f"{vehicle}: ", mapping(of_vehicle).get("counters")))
        groups += [(f"{vehicle}/{name}: ", counters) for name, counters in _first(mapping(of_vehicle).get("receivers"))]
    for prefix, counters in groups:
        for name, value in _first(counters):
            if (count := number(value)) is not None and (shown := _plain(count, 6)) != "0":
                unit = " s" if name.endswith("_s") else ""
                label = "worst lateness" if name == "latest_s" else name.removesuffix("_s").replace("_", " ")
                yield one_line(prefix + label), shown + unit


def _first(value: object) -> list[tuple[str, Any]]:
    """Return the entries of an object, a bounded number of them."""
    return list(mapping(value).items())[:_MOST]


def _plain(value: float, digits: int) -> str:
    """Return a number with at most `digits` decimal places."""
    return f"{value:.{digits}f}".rstrip("0").rstrip(".")


def merged(every: Sequence[Facts]) -> list[tuple[str, list[tuple[str, list[str]]]]]:
    """Return the facts of several runs beside each other; "" for a missing fact."""
    result = []
    for heading in _union(every):
        rows = [one.get(heading, {}) for one in every]
        result.append((heading, [(label, [row.get(label, "") for row in rows]) for label in _union(rows)]))
    return result


def _union(every: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the keys of all, in their order; a key of later ones only follows the key before it."""
    keys: list[str] = []
    for one in every:
        at = 0
        for key in one:
            if key in keys:
                at = keys.index(key) + 1
            else:
                keys.insert(at, key)
                at += 1
    return keys


def errors_m(recording: Recording) -> dict[int, float]:
    """Return the horizontal error [m] of each place found whose transmitter is known, by its index among them.

    Without an id in the frames: from the nearest transmitter.
    """
    there = _truth(recording)
    if not there:
        return {}
    found = {}
    for index, (name, place) in enumerate(_places(recording)):
        vehicle = name or recording.receivers[0].vehicle
        at = recording.of_search([place.north, place.east, place.down or 0.0], vehicle)
        if at is not None:
            away = {id_: math.dist(at[:2].tolist(), position[:2]) for id_, position in there.items()}
            found[index] = away[place.id] if place.id in away else min(away.values())
    return found


def missed(recording: Recording) -> list[int]:
    """Return the ids of the transmitters that were wanted and not found; empty if the places have no ids."""
    found, wanted = {place.id for _, place in _places(recording)}, _wanted(recording)
    if None in found or (wanted is not None and len(found) >= wanted):
        return []
    return [id_ for id_ in _truth(recording) if id_ not in found]


def found_of(recording: Recording) -> str:
    """Return the number of victims found, of those wanted: "2 of 3 found, 1 not sure"; "" without a search."""
    if not recording.searches:
        return ""
    sure = [place.sure for _, place in _places(recording)]
    count, unsure = sure.count(True), sure.count(False)
    of = _wanted(recording) or len(_truth(recording)) or None
    doubt = f", {unsure} not sure" if unsure else ""
    return f"{count}{'' if of is None else f' of {of}'} found{doubt}"


def _wanted(recording: Recording) -> int | None:
    """Return the number of victims to find; None for all, which a team searches for."""
    wanted = recording.search.outcome.get("wanted", 1) if recording.search else None
    return wanted if isinstance(wanted, int) else None


def _truth(recording: Recording) -> dict[int, list[float]]:
    """Return the true places of the transmitters at the end, NED from the datum, by id; empty if they are not known."""
    if not recording.receivers:
        return {}
    there = recording.transmitters(recording.receivers[0].vehicle, recording.span_s[1])
    if there is None:
        return {}
    places = zip(there.ids, there.positions.tolist(), strict=True)
    return {id_: position for id_, position in places if id_ not in there.unplaced}
