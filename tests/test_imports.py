"""The house's map holds: who may import whom, and that only the clock asks what time it is."""

from __future__ import annotations

import ast
import functools
import sys
from pathlib import Path

import pytest

from tests.every import every

ROOT = Path(__file__).parent.parent
ROOMS = {  # a room → what of ours it may import
    "firmware_proto": {"firmware_proto"},
    "arva_hil/errors.py": set(),
    "arva_hil/frozen.py": set(),
    "arva_hil/registry.py": set(),
    "arva_hil/ranges.py": set(),
    "arva_hil/safe_text.py": set(),
    "arva_hil/files.py": set(),
    "arva_hil/field": {"arva_hil.field"},
    "arva_hil/receiver": {"arva_hil.field", "arva_hil.receiver"},
    "arva_hil/mavlink": {"arva_hil.mavlink"},
    "arva_hil/config": {
        "arva_hil.ranges",
        "arva_hil.config",
        "arva_hil.field.geodesy",
        "arva_hil.field.keying",
        "arva_hil.field.terrain",
    },
    "arva_hil/events": {
        "arva_hil.events",
        "arva_hil.field",
        "arva_hil.mavlink",
        "arva_hil.receiver",
        "arva_hil.vehicle.reasons",
        "firmware_proto",
    },
    "arva_hil/vehicle": {
        "arva_hil.events",
        "arva_hil.field",
        "arva_hil.mavlink",
        "arva_hil.receiver",
        "arva_hil.vehicle",
    },
    "arva_hil/flight": {
        "arva_hil.events",
        "arva_hil.field",
        "arva_hil.flight",
        "arva_hil.mavlink",
        "arva_hil.vehicle",
    },
    "arva_hil/faults": {"arva_hil.config", "arva_hil.faults", "arva_hil.field", "arva_hil.receiver", "firmware_proto"},
    "arva_hil/emulator": {  # no links, no console, no clock
        "arva_hil.__version__",
        "arva_hil.config",
        "arva_hil.emulator",
        "arva_hil.events",
        "arva_hil.faults",
        "arva_hil.field",
        "arva_hil.mavlink",
        "arva_hil.receiver",
        "arva_hil.vehicle",
        "firmware_proto",
    },
    "arva_hil/links": {"arva_hil.links", "arva_hil.runtime.clock"},
    "arva_hil/runtime": {
        "arva_hil.emulator",
        "arva_hil.events",
        "arva_hil.files",
        "arva_hil.links",
        "arva_hil.mavlink.signing",
        "arva_hil.observers.audience",
        "arva_hil.runtime",
    },
    "arva_hil/runtime/clock.py": set(),
    "arva_hil/runtime/worker_thread.py": set(),
    "arva_hil/runtime/link_monitor.py": {"arva_hil.events", "arva_hil.links"},
    "arva_hil/observers": {
        "arva_hil.events",
        "arva_hil.field",
        "arva_hil.files",
        "arva_hil.safe_text",
        "arva_hil.links",
        "arva_hil.mavlink",
        "arva_hil.messages",
        "arva_hil.observers",
        "arva_hil.receiver",
        "arva_hil.runtime.clock",
        "arva_hil.runtime.worker_thread",
        "arva_hil.search.outcome",
        "arva_hil.vehicle.reasons",
        "firmware_proto",
    },
    "arva_hil/observers/audience.py": {"arva_hil.events", "arva_hil.safe_text"},
    "arva_hil/messages": {
        "arva_hil.config",
        "arva_hil.emulator",
        "arva_hil.events",
        "arva_hil.field",
        "arva_hil.messages",
        "arva_hil.receiver",
        "arva_hil.recordings",
        "arva_hil.safe_text",
        "firmware_proto",
    },
    "arva_hil/fleet_links.py": {
        "arva_hil.config",
        "arva_hil.emulator",
        "arva_hil.links",
        "arva_hil.mavlink.packet_reader",
        "arva_hil.vehicle.session",
    },
    "arva_hil/viewer.py": {
        "arva_hil.events",
        "arva_hil.field",
        "arva_hil.observers.console",
        "arva_hil.observers.web",
        "arva_hil.recordings",
    },
    "arva_hil/recordings": {
        "arva_hil.config",
        "arva_hil.emulator.build",
        "arva_hil.emulator.engine",
        "arva_hil.field",
        "arva_hil.links",
        "arva_hil.mavlink",
        "arva_hil.observers.record",
        "arva_hil.recordings",
        "arva_hil.runtime.clock",
        "arva_hil.safe_text",
    },
    "arva_hil/exports": {
        "arva_hil.__version__",
        "arva_hil.exports",
        "arva_hil.field",
        "arva_hil.messages",
        "arva_hil.recordings",
        "arva_hil.runtime.clock",
        "arva_hil.safe_text",
    },
    "arva_hil/pictures": {
        "arva_hil.field",
        "arva_hil.files",
        "arva_hil.observers.web.field_lines",
        "arva_hil.pictures",
        "arva_hil.range_test",
        "arva_hil.recordings",
        "arva_hil.safe_text",
        "arva_hil.search.outcome",
    },
    "arva_hil/range_test": {
        "arva_hil.config",
        "arva_hil.emulator.build",
        "arva_hil.field",
        "arva_hil.range_test",
        "arva_hil.receiver",
        "arva_hil.safe_text",
    },
    "arva_hil/report": {
        "arva_hil.__version__",
        "arva_hil.config",
        "arva_hil.pictures",
        "arva_hil.recordings",
        "arva_hil.report",
        "arva_hil.safe_text",
    },
    "arva_hil/search": {  # never the model, never where the transmitters are
        "arva_hil.events",
        "arva_hil.field.geodesy",
        "arva_hil.field.mount",
        "arva_hil.field.quaternion",
        "arva_hil.field.rotation",
        "arva_hil.flight",
        "arva_hil.links",
        "arva_hil.mavlink",
        "arva_hil.observers.console.reasons",  # the words of how it ended
        "arva_hil.runtime.clock",
        "arva_hil.runtime.link_monitor",
        "arva_hil.safe_text",
        "arva_hil.search",
        "arva_hil.vehicle",
        "firmware_proto",
    },
    "arva_hil/simulated": {
        "arva_hil.config",
        "arva_hil.emulator",
        "arva_hil.events",
        "arva_hil.field",
        "arva_hil.links",
        "arva_hil.mavlink",
        "arva_hil.observers.audience",
        "arva_hil.runtime",
        "arva_hil.search",
        "arva_hil.simulated",
        "arva_hil.vehicle",
        "firmware_proto",
    },
    "arva_hil/campaign": {
        "arva_hil.__version__",
        "arva_hil.campaign",
        "arva_hil.pictures.style",
        "arva_hil.report.html",
        "arva_hil.config",
        "arva_hil.field",
        "arva_hil.files",
        "arva_hil.links",
        "arva_hil.receiver",
        "arva_hil.runtime",
        "arva_hil.safe_text",
        "arva_hil.search",
        "arva_hil.simulated.closed_fleet",
        "arva_hil.simulated.closed_loop",
    },
    "arva_hil/doctor": {
        "arva_hil.config",
        "arva_hil.doctor",
        "arva_hil.emulator",
        "arva_hil.events",
        "arva_hil.links",
        "arva_hil.mavlink",
        "arva_hil.observers.console.reasons",
        "arva_hil.observers.console.sentences",
        "arva_hil.runtime.clock",
        "arva_hil.vehicle",
        "firmware_proto",
    },
    "arva_hil/doctor/diagnosis.py": {"arva_hil.doctor.values"},
}
EVERYBODY = {
    "arva_hil.errors",
    "arva_hil.frozen",
    "arva_hil.registry",
}  # they import nothing of ours, the registry what it is asked for
OF_OTHERS = {  # a room → the only packages it may import that are neither ours nor Python's
    "firmware_proto": {"fastcrc"},
    "arva_hil/field": {"numpy"},
    "arva_hil/receiver": {"annotated_types", "numpy"},
    "arva_hil/links": {"serial"},
    "arva_hil/messages": {"numpy"},
    "arva_hil/config": {"pydantic", "pydantic_core", "yaml"},
}


def files(room: str) -> list[Path]:
    path = ROOT / room
    return [path] if path.suffix == ".py" else sorted(path.rglob("*.py"))


@functools.cache
def parsed(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(ast.parse(path.read_text())))


@functools.cache
def imports(path: Path) -> frozenset[str]:
    """Absolute names of all that a file imports, wherever in it."""
    package = ".".join(path.relative_to(ROOT).parent.parts)
    found = set()
    for node in parsed(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package.rsplit(".", node.level - 1)[0] + "." if node.level else ""
            name = f"{above}{node.module or ''}".rstrip(".")
            found |= {f"{name}.{alias.name}" for alias in node.names} if name == "arva_hil" else {name}
    return frozenset(found - {"__future__"})


def within(name: str, allowed: set[str]) -> bool:
    return any(name == room or name.startswith(room + ".") for room in allowed)


@every("room", ROOMS)
def test_a_room_imports_only_what_the_map_allows(room: str) -> None:
    assert files(room)
    allowed = ROOMS[room] | (EVERYBODY if room.startswith("arva_hil") else set())
    for path in files(room):
        ours = {name for name in imports(path) if within(name, {"arva_hil", "firmware_proto", "tools", "tests"})}
        assert not {name for name in ours if not within(name, allowed)}, path


@pytest.mark.parametrize("room", OF_OTHERS)
def test_a_room_leans_on_few_others(room: str) -> None:
    for path in files(room):
        others = {name.partition(".")[0] for name in imports(path)} - set(sys.stdlib_module_names)
        assert others - {"arva_hil", "firmware_proto"} <= OF_OTHERS[room], path


def test_nothing_but_the_commands_imports_the_commands_and_only_they_a_trial_and_the_api_import_the_loop() -> None:
    for path in files("arva_hil"):
        if "cli" not in path.parts and path.name not in ("__main__.py", "trial.py", "api.py"):
            assert not {name for name in imports(path) if within(name, {"arva_hil.cli", "arva_hil.runtime.loop"})}, path


def test_only_the_clock_asks_for_the_time() -> None:
    askers = {path.name for path in files("arva_hil") if imports(path) & {"time", "datetime", "sched"}}
    assert askers == {"clock.py"}


def test_what_is_printed_goes_through_one_place() -> None:
    printers = {
        str(path.relative_to(ROOT))
        for path in files("arva_hil")
        for node in parsed(path)
        if (isinstance(node, ast.Name) and node.id == "print")
        or (
            isinstance(node, ast.Attribute)
            and node.attr in ("write", "writelines", "print_exc", "print_exception")
            and isinstance(node.value, ast.Attribute | ast.Name)
            and ast.unparse(node.value) in ("sys.stdout", "sys.stderr", "traceback", "stdout", "stderr")
        )
    }
    assert printers == {"arva_hil/cli/terminal.py"}
