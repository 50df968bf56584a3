"""Prints the figures of the house: the length of its ways, its largest classes, its statements.

    python -m tools bench house

Modules in a circle import each other, also inside functions and for type checkers only. A way is followed
with `sys.setprofile`: the calls of the package's own functions, the files they are in, and how often the next call is
in another file than the one before. Comprehensions do not count: they are calls before Python 3.12 only. Statements
are counted with `ast`, without docstrings.
"""

from __future__ import annotations

import ast
import functools
import sys
from collections import Counter
from collections.abc import Callable
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import FrameType
from typing import Any, Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
_OURS: Final = tuple(f"{ROOT / name}/" for name in ("arva_hil", "firmware_proto"))
_SCENARIO: Final = "transmitters: [{id: 7, ned: [20, 5, 0]}]\nreceiver: {rate_hz: 10}\n"


class Way(NamedTuple):
    """The calls of a piece of work, in their order: file and function of each."""

    calls: list[tuple[str, str]]

    @property
    def files(self) -> int:
        return len({file for file, _ in self.calls})

    @property
    def changes(self) -> int:
        """The number of calls in another file than the call before."""
        return sum(one[0] != other[0] for one, other in zip(self.calls, self.calls[1:], strict=False))

    def __str__(self) -> str:
        return f"{len(self.calls)} calls, {self.files} files, {self.changes} changes of file"


def followed(work: Callable[[], object]) -> Way:
    """Follow a piece of work."""
    calls: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, argument: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(_OURS) and not code.co_name.endswith("comp>"):
            calls.append((str(Path(code.co_filename).relative_to(ROOT)), code.co_name))

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return Way(calls)


def packet_to_frame() -> Way:
    """One packet of the vehicle, and the frame that is due then: from the packet's bytes to the frame's.

    Without the status report, which happens to be due at the same time.
    """
    from arva_hil.autopilot.following.session import Session
    from arva_hil.config import parse
    from arva_hil.emulator.engine import Emulator
    from arva_hil.emulator.setup import one_vehicle
    from arva_hil.mavlink.codec import Encoder, dialect

    engine, encoder = (
        Emulator([one_vehicle(parse(_SCENARIO, "house"), Session(passive=True))], start=0.0, tell_status=False),
        Encoder(1, 1),
    )

    def said(now: float) -> list[bytes]:
        ms = round(1e3 * now) + 1000
        place = dialect.MAVLink_global_position_int_message(ms, 460_000_000, 70_000_000, 500_000, 0, 100, 0, 0, 0)
        attitude = dialect.MAVLink_attitude_message(ms, 0.1, 0.0, 0.0, 0.5, 0.0, 0.0)
        home = dialect.MAVLink_home_position_message(460_000_000, 70_000_000, 500_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
        beat = dialect.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3)
        return [encoder.pack(one) for one in (beat, home, attitude, place)]

    def serve(now: float, packets: list[bytes]) -> None:
        for packet in packets:
            engine.receive("autopilot", packet, now)
        engine.advance(now)
        for output in engine.output():
            engine.written(output.id, True, now)
        engine.events()

    for n in range(20):
        serve(0.1 * n + 1e-6, said(0.1 * n))
    last = said(2.0)[-1:]
    return followed(lambda: serve(2.0 + 1e-6, last))


def transmitter_to_field() -> Way:
    """A transmitter of a scenario's text, and its field at a point."""
    import numpy as np

    from arva_hil.config import parse
    from arva_hil.emulator.build import moving_transmitters
    from arva_hil.model.field import LocalFrame

    frame, point = LocalFrame(46.0, 7.0, 500.0), np.zeros(3)

    def work() -> None:
        scenario = parse(_SCENARIO, "house")
        moving_transmitters(scenario, frame).at(0.0).field_at(point)

    work()
    return followed(work)


def frame_to_set_point() -> Way:
    """One frame of the receiver, and the set-point that is due then: from the frame's bytes to the set-point's.

    The search flies to a transmitter. Nothing waits on the autopilot's link, and there is no observer. The shortest of
    several steps counts, because a heartbeat, a request or a claim may leave in the same step.
    """
    from arva_hil.clock import StepClock
    from arva_hil.config import parse
    from arva_hil.registry import STRATEGIES
    from arva_hil.runtime.loop import run
    from arva_hil.search.strategies.plan import SearchPlan
    from arva_hil.simulated.closed_loop import ClosedLoop, in_memory
    from firmware_proto import encode

    clock, scenario, wires = StepClock(), parse(_SCENARIO, "house"), in_memory()
    plan = SearchPlan(STRATEGIES["flux"])
    loop = ClosedLoop(scenario, plan, wires=[wires], start=0.0, stream_hz=10.0, emit=lambda name, event: None)
    search, ways = loop.drones[0].search, []
    run(loop.tasks, clock, until=60.0, stopped=lambda: bool(search.mission and search.mission.choice.hunting))
    for _ in range(10):
        run(loop.tasks, clock, until=clock.now() + 1.1)
        while any(link.ready() for link in search.links) or search.service(clock) <= clock.now():
            search.service(clock)
        clock.wait(clock.now() + 0.2)
        frame = loop.emulator.vehicles[0].units[0].port.last
        assert frame is not None
        wires.port[1].write(encode(frame.frame._replace(sequence=(frame.frame.sequence + 1) % 256)))
        ways.append(followed(lambda: search.service(clock)))
    return min(ways, key=lambda way: len(way.calls))


@functools.cache
def modules(folder: str) -> dict[str, ast.Module]:
    """Parse every module below a folder. Returns them by their dotted names, a package by its own name."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): ast.parse(
            path.read_text(encoding="utf-8")
        )
        for path in sorted((ROOT / folder).rglob("*.py"))
    }


def arrows(of: dict[str, ast.Module]) -> dict[str, set[str]]:
    """Return the modules that each module imports, also inside functions and for type checkers only.

    The package itself has names only, and does not count.
    """
    found: dict[str, set[str]] = {name: set() for name in of}
    for name, tree in of.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and not node.level:
                for one in node.names:
                    deeper = f"{node.module}.{one.name}"
                    found[name].add(deeper if deeper in of else node.module or "")
            elif isinstance(node, ast.Import):
                found[name] |= {one.name for one in node.names}
    return {name: (wanted & of.keys()) - {name, "arva_hil"} for name, wanted in found.items()}


def circle(of: dict[str, set[str]]) -> list[str]:
    """Return modules that import each other in a circle, the first one twice; none without a circle."""
    try:
        TopologicalSorter(of).prepare()
    except CycleError as error:
        found: list[str] = error.args[1]
        return found
    return []


def rooms(of: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return the places at the top of the package that each of them imports."""
    found: dict[str, set[str]] = {}
    for name, wanted in of.items():
        if "." in name:
            place = name.split(".")[1]
            found.setdefault(place, set()).update(other.split(".")[1] for other in wanted if "." in other)
            found[place].discard(place)
    return found


def statements(folder: str) -> int:
    """Count statements, without docstrings."""

    def is_text(node: ast.AST) -> bool:
        return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)

    return sum(
        isinstance(node, ast.stmt) and not is_text(node) for tree in modules(folder).values() for node in ast.walk(tree)
    )


def classes() -> list[tuple[str, int]]:
    """Return the name of each class of the package, and how many attributes its methods set."""
    found = []
    for tree in modules("arva_hil").values():
        for one in ast.walk(tree):
            if isinstance(one, ast.ClassDef):
                names = {
                    node.attr
                    for node in ast.walk(one)
                    if isinstance(node, ast.Attribute)
                    and isinstance(node.ctx, ast.Store)
                    and isinstance(node.value, ast.Name)
                    and node.value.id == "self"
                }
                found.append((one.name, len(names)))
    return found


def main() -> None:
    print("one packet → one frame's bytes:", packet_to_frame())
    print("one receiver frame → a set-point:", frame_to_set_point())
    print("a scenario's transmitter → field:", transmitter_to_field())
    imported = arrows(modules("arva_hil"))
    places = rooms(imported)
    print("circles of files:", " ← ".join(circle(imported)) or 0)
    print("circles of rooms:", " ← ".join(circle(places)) or 0)
    print("places at the top of arva_hil/:", len(places))
    every = classes()
    twice = sorted(name for name, times in Counter(name for name, _ in every).items() if times > 1)
    print("class names that stand twice:", ", ".join(twice) or "none")
    largest = sorted(every, key=lambda one: -one[1])[:5]
    print("attributes of the largest classes:", ", ".join(f"{name} {count}" for name, count in largest))
    for folder in ("arva_hil", "tests", "tools"):
        print(f"statements of {folder}/: {statements(folder)}")
