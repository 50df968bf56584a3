"""Prints the figures of the house: how long its ways are, its largest classes, its statements.

    python -m tools.house

A way is followed with `sys.setprofile`: the calls of the package's own functions, the files they are in, and how often
the next call is in another file than the one before. Statements are counted with `ast`, without docstrings.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any, Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
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
        if event == "call" and frame.f_code.co_filename.startswith(_OURS):
            calls.append((str(Path(frame.f_code.co_filename).relative_to(ROOT)), frame.f_code.co_name))

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return Way(calls)


def packet_to_frame() -> Way:
    """One packet of the vehicle, and the frame that is due then: from the packet's bytes to the frame's."""
    from arva_hil.autopilot.following.session import Session
    from arva_hil.config import parse
    from arva_hil.emulator.engine import Emulator
    from arva_hil.emulator.setup import one_vehicle
    from arva_hil.mavlink.codec import Encoder, dialect

    engine, encoder = (
        Emulator([one_vehicle(parse(_SCENARIO, "house"), Session(passive=True))], start=0.0),
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


def trees(folder: str) -> Iterator[ast.Module]:
    """Parse every module below a folder."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        yield ast.parse(path.read_text(encoding="utf-8"))


def statements(folder: str) -> int:
    """Count statements, without docstrings."""

    def is_text(node: ast.AST) -> bool:
        return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)

    return sum(isinstance(node, ast.stmt) and not is_text(node) for tree in trees(folder) for node in ast.walk(tree))


def classes() -> list[tuple[str, int]]:
    """Return the name of each class of the package, and how many attributes its methods set."""
    found = []
    for tree in trees("arva_hil"):
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
    print("a scenario's transmitter → field:", transmitter_to_field())
    every = classes()
    twice = sorted(name for name, times in Counter(name for name, _ in every).items() if times > 1)
    print("class names that stand twice:", ", ".join(twice) or "none")
    largest = sorted(every, key=lambda one: -one[1])[:5]
    print("attributes of the largest classes:", ", ".join(f"{name} {count}" for name, count in largest))
    for folder in ("arva_hil", "tests", "tools"):
        print(f"statements of {folder}/: {statements(folder)}")


if __name__ == "__main__":
    main()
