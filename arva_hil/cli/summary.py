"""The summary of a run: the entries of run.json, and a few lines for a person."""

from __future__ import annotations

import dataclasses
import sys
from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

from arva_hil import __version__
from arva_hil.autopilot.following.session import Session
from arva_hil.clock import RealClock, utc
from arva_hil.config import Scenario, to_dict
from arva_hil.emulator.datum import Datum
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.ports import Port
from arva_hil.events.words.reasons import in_words
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.records.writing.layout import RecordLayout
from arva_hil.runtime.drivers import Live

_OF_LINKS: Final = {"autopilot": "the autopilot's link", "port": "the port"}


def lost_links(live: Live) -> list[str]:
    """Return a line for each link that was lost."""
    return [
        f"{_OF_LINKS.get(name, name)} was lost {link.losses} ×, and came back {link.returns} ×"
        for name, link in live.sinks.items()
        if link.losses
    ]


def known_at_start(chosen: Scenario) -> dict[str, Any]:
    """Return the entries of run.json that are known at the start. Of the libraries, those that this run uses."""
    import platform  # slow to import, and only records need it

    machine = platform.uname()
    used = [sys.modules[name] for name in ("fastcrc", "numpy", "pymavlink", "serial", "yaml") if name in sys.modules]
    return {
        "started": utc(RealClock().epoch_us),
        "command": sys.argv,
        "scenario": to_dict(chosen),
        "scenario_source": chosen.source,
        "seed": chosen.seed,
        "versions": {
            "arva-hil": __version__,
            "python": platform.python_version(),
            **{library.__name__: library.__version__ for library in used},
            # like `platform.platform()`, which starts another program to find the processor
            "platform": f"{machine.system}-{machine.release}-{machine.machine}-with-{''.join(platform.libc_ver())}",
        },
    }


def is_one(emulator: Emulator) -> bool:
    """Return True if there is one vehicle with one receiver."""
    return sum(len(vehicle.units) for vehicle in emulator.vehicles) == 1


def as_dict(emulator: Emulator, counts: Mapping[str, int], layout: RecordLayout) -> dict[str, Any]:
    """Return the entries of run.json for vehicles and receivers at the end, and the `counts` of their links."""
    if is_one(emulator):
        (vehicle,) = emulator.vehicles
        return {
            **vehicle_entries(vehicle.session, vehicle.world.datum),
            "counters": {**counters(emulator), **counts},
        }
    return {
        "vehicles": {
            vehicle.name: {
                **vehicle_entries(vehicle.session, vehicle.world.datum),
                "link": vehicle.link,
                "tlog": layout.tlog(vehicle.link),
                "counters": vehicle.session.counts(),
                "receivers": {port.name: _receiver(port) for _, port in vehicle.units},
            }
            for vehicle in emulator.vehicles
        },
        "counters": dict(counts),
    }


def vehicle_entries(session: Session, datum: Datum) -> dict[str, Any]:
    """Return the entries of run.json for a vehicle; None for one that was not found."""
    return {
        "vehicle": dataclasses.asdict(session.vehicle) if session.vehicle else None,
        "datum": datum.of_the_flight,
        "datums": [change._asdict() | {"why": in_words(change.why)} for change in datum.changes],
    }


def _receiver(port: Port) -> dict[str, Any]:
    commands = {"commands": dataclasses.asdict(port.commands.counters)} if port.commands else {}
    return {**dataclasses.asdict(port.counters), **commands, "faults": port.fault_counts()}


def counters(emulator: Emulator) -> dict[str, Any]:
    """Return every counter of a run of one vehicle with one receiver."""
    (vehicle,) = emulator.vehicles
    ((_, port),) = vehicle.units
    return {**_receiver(port), **vehicle.session.counts()}


def summary_lines(emulator: Emulator) -> list[str]:
    """Return the summary for a person."""
    one, lines = is_one(emulator), list[str]()
    users = Counter(vehicle.link for vehicle in emulator.vehicles)
    found = {vehicle.link for vehicle in emulator.vehicles if vehicle.session.vehicle}
    for vehicle in emulator.vehicles:
        for _, port in vehicle.units:
            of = "" if one else f"{vehicle.name}/{port.name}: "
            c = port.counters
            taken = f"{c.delivered + c.damaged} sent, {c.dropped} dropped, {c.no_pose} without a pose"
            lines.append(f"{of}{c.frames} frames: {taken}; worst lateness {c.latest_s * 1e3:.1f} ms")
            lines += [of + line for line in _mishaps(port)]
        heard = _heard(vehicle.session, alone=users[vehicle.link] == 1, others=vehicle.link in found)
        lines += [line if one else f"{vehicle.name}: {line}" for line in heard]
    for link, number in users.items():
        if number > 1:
            sessions = [vehicle.session for vehicle in emulator.vehicles if vehicle.link == link]
            whose = "" if link in found else "no vehicle was found; "
            lines.append(f"{link} ({number} vehicles): {whose}{_came(sessions[0].reader)}")
            lines += [f"{link}: {line}" for line in _not_used(_of(sessions[0], "packets"))]
    return lines


def _came(reader: PacketReader) -> str:
    parser = reader.parser
    return (
        f"{reader.bytes} bytes, {parser.packets} packets, {parser.bad_crc} bad checksums, "
        f"{parser.skipped} bytes skipped"
    )


def _heard(session: Session, *, alone: bool, others: bool) -> list[str]:
    """Return the traffic of a vehicle, in words. `alone`: on its link. `others`: another vehicle was found there."""
    whose = "autopilot" if session.vehicle else "no vehicle was found; its link"
    lines = [f"{whose}: {_came(session.reader)}, {session.ignored} packets of others ignored"] if alone else []
    if not alone and not session.vehicle and others:
        lines.append("no vehicle was found")
    return lines + _not_used(session.disbelieved() if alone else _of(session, "values"))


def _of(session: Session, what: str) -> dict[str, int]:
    """Return the counts of a link's "packets", or of a vehicle's "values", that were not used."""
    return {name: n for name, n in session.disbelieved().items() if name.startswith("packets_") == (what == "packets")}


def _not_used(counts: Mapping[str, int]) -> list[str]:
    """Return a line about unused packets and values, if there are any."""
    doubts = [f"{n} {name.replace('_', ' ')}" for name, n in counts.items() if n]
    return [f"not used: {', '.join(doubts)}"] if doubts else []


def _mishaps(port: Port) -> list[str]:
    lines, c = [], port.counters
    if counts := port.fault_counts():
        each = ", ".join(f"{name} {count['frames']}" for name, count in counts.items())
        lines.append(
            f"faults: {c.withheld} frames withheld, {c.damaged} damaged, {c.duplicated} sent again, "
            f"{c.waiting} not sent yet ({each})"
        )
    if port.commands and ((counts_ := port.commands.counters).commands or counts_.bytes_dropped):
        said = ", ".join(f"{getattr(counts_, name)} {name}" for name in ("done", "refused", "unknown", "busy"))
        lines.append(f"commands: {counts_.commands} came: {said}, {counts_.unanswered} not answered")
        if counts_.bytes_dropped:
            lines[-1] += f"; {counts_.bytes_dropped} bytes in no command"
    if c.skipped:
        lines.append(f"{c.skipped} frames were skipped: the program was delayed by more than a second")
    return lines
