"""The house's map holds: who may import whom, and that only the clock asks what time it is."""

from __future__ import annotations

import ast
import functools
import subprocess
import sys
from pathlib import Path

import pytest

from tests.every import every

ROOT = Path(__file__).parent.parent
FLOORS = """mavlink model links config events autopilot emulator runtime search records observers simulated
    campaign bench api cli""".split()  # from the ground up: a room imports rooms below it, and none above
SMALL_FLOORS = {  # the same inside a room
    "arva_hil/autopilot": "following commanding",
    "arva_hil/model": "field receiver",
    "arva_hil/search": "strategies team mission flight",
}
GROUND = {"errors", "registry", "clock", "safe_text", "__version__"}  # everybody may import these
OF_OTHERS = {  # a room → the only packages it may import that are neither ours nor Python's
    "firmware_proto": {"fastcrc"},
    "arva_hil/model/field": {"numpy"},
    "arva_hil/model/receiver": {"annotated_types", "numpy"},
    "arva_hil/links": {"can", "dronecan", "serial"},
    "arva_hil/records/ros_messages": {"numpy", "rosbags"},
    "arva_hil/config": {"yaml"},
}


def files(room: str) -> list[Path]:
    path = ROOT / room
    return [path] if path.suffix == ".py" else sorted(path.rglob("*.py"))


WITHOUT_UNIX = """
import importlib, pkgutil, signal, sys, arva_hil
sys.modules |= dict.fromkeys(("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"))
for name in ("SIGALRM", "SIGHUP", "SIGKILL", "SIGUSR1", "SIG_BLOCK", "SIG_SETMASK", "pthread_sigmask"):
    delattr(signal, name)
for module in pkgutil.walk_packages(arva_hil.__path__, "arva_hil."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
with arva_hil.Bench(port="memory") as bench:
    assert len(bench.advance(3)) == 3
try:
    arva_hil.Bench()
except arva_hil.LinkError as error:
    assert "tcpin:127.0.0.1:5760" in str(error) and "com0com" in str(error), error
"""


AT_ONCE = """
import sys
sys.path.insert(0, ".")
import arva_hil.__main__
sys.exit("typing" in sys.modules or "re" in sys.modules)
"""


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


def rooms_of(path: Path, below: str) -> set[str]:
    """The rooms directly below the package `below` that a module imports."""
    return {name.removeprefix(below + ".").partition(".")[0] for name in imports(path) if name.startswith(below + ".")}


@pytest.mark.parametrize(
    ("house", "floors"), [("arva_hil", FLOORS), *((k, v.split()) for k, v in SMALL_FLOORS.items())]
)
def test_a_room_imports_only_rooms_below_it(house: str, floors: list[str]) -> None:
    for above, floor in enumerate(floors):
        for path in files(f"{house}/{floor}") or files(f"{house}/{floor}.py"):
            assert rooms_of(path, house.replace("/", ".")) <= GROUND | {*floors[: above + 1]}, path


def test_the_house_has_few_places_at_the_top() -> None:
    top = (ROOT / "arva_hil").iterdir()
    places = {path.name for path in top if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert len(places) <= 22, sorted(places)
    assert {*FLOORS} == {place.removesuffix(".py") for place in places} - GROUND - {"__init__", "__main__"}


def test_what_is_on_the_wire_imports_nothing_of_the_program() -> None:
    for path in files("firmware_proto"):
        assert not rooms_of(path, "arva_hil"), path


@every("room", OF_OTHERS)
def test_a_room_leans_on_few_others(room: str) -> None:
    for path in files(room):
        others = {name.partition(".")[0] for name in imports(path)} - set(sys.stdlib_module_names)
        assert others - {"arva_hil", "firmware_proto"} <= OF_OTHERS[room], path


def test_nothing_but_the_commands_imports_the_commands_and_only_they_a_trial_and_the_api_import_the_loop() -> None:
    for path in files("arva_hil"):
        if "cli" not in path.parts and path.name not in ("__main__.py", "trial.py", "api.py"):
            public = {"arva_hil.cli.options"} if path == ROOT / "arva_hil/__init__.py" else set()  # its public name
            wrong = {name for name in imports(path) if within(name, {"arva_hil.cli", "arva_hil.runtime.loop"})} - public
            assert not wrong, path


def test_only_the_clock_asks_for_the_time() -> None:
    askers = {path.name for path in files("arva_hil") if imports(path) & {"time", "datetime", "sched"}}
    assert askers == {"clock.py"}


def test_every_module_can_be_imported_without_what_only_unix_has() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT_UNIX], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_program_handles_ctrl_c_before_it_imports_what_takes_milliseconds() -> None:
    words = [sys.executable, "-I", "-S", "-c", AT_ONCE]
    assert subprocess.run(words, cwd=ROOT, check=False, timeout=60).returncode == 0


def test_the_bench_the_codec_the_emulator_and_listen_need_no_module_of_unix_at_their_top() -> None:
    of_unix = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}
    for room in ("arva_hil/bench", "arva_hil/emulator", "arva_hil/cli/listen.py", "firmware_proto"):
        for path in files(room):
            top = ast.parse(path.read_text()).body
            names = {alias.name for node in top if isinstance(node, ast.Import) for alias in node.names}
            names |= {node.module or "" for node in top if isinstance(node, ast.ImportFrom)}
            assert not names & of_unix, path


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
