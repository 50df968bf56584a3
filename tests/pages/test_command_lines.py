"""Every shell line of README and the pages is run, or is named here with the reason why it is not.

Serial ports are pseudo-terminals, addresses are free ones, the vehicle is the built-in one, and what runs until it is
told to stop is told so once it does what it is there for; a `run` of which neither a record nor a link to an autopilot
is asked for begins, and ends for nobody is there. The same flight recorded in several folders is flown once.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import runpy
import shlex
import shutil
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from arva_hil.cli import range_test
from arva_hil.cli.main import main
from arva_hil.links.pty import PtyLink
from tests.cli import flown
from tests.cli.far_ends import UNDER_TEST, Beacon, Program
from tests.free_ports import free_port
from tests.once import once
from tests.undrawn import undrawn

from .pages import ROOT, Typed, pages, shell_lines

NOT_RUN = {  # what a line begins with → why it is not run here
    r"make (demo|test|test-fast|lint|docs|dist)$": "calls what other tests call, after an installation by pip",
    r"python3 -m venv|\. |(~/mavproxy/bin/)?pip install": "installs from the network; so does `make dist`",
    r"sudo(edit)? ": "changes the system; tests/cli/test_commands.py runs the unit's command",
    r"(DASK_\w+=\S+ )?dask |arva-hil campaign plan\.yaml ": "tests/cli/test_campaign.py runs them",
    r"gdal": "needs GDAL and the grid of a survey",
    r"docker ": "needs docker; tests/cli/test_commands.py reads the Containerfile",
    r"sim_vehicle\.py|make px4|ARVA_HIL_(ARDUCOPTER|PX4)=|PX4_PARAM|px4-": "needs a simulator: tests/sitl",
    r"~/mavproxy/": "needs MAVProxy, a ground station with a screen",
    r"python -m tools sitl fly": "needs a simulator",
    r"cmake |ninja ": "needs PX4's sources; tests/firmware_proto/test_px4_module.py compiles the module",
    r"arm-none-eabi-gcc|qemu-system-arm": "tests/firmware_proto/test_stm32.py runs it where they are installed",
    r"arva-hil (record|decode|fit|compare) ": "needs a flight: see tests/cli/test_record.py",
    r"arva-hil (vehicle --link pty:|--autopilot /tmp/vehicle-1)": "ends with that flight",
    r"arva-hil range-test$": "walks for seconds: tests/cli/test_of_records.py walks a little",
    r"arva-hil demo --scenario builtin:four_transmitters --victims 2": "tests/cli/test_demo.py finds two that are near",
    r"arva-hil demo( --foxglove)?$": "flies for 50 s; tests/cli/test_demo.py and test_foxglove.py fly faster",
    r"arva-hil (vehicle --count 8|(run|search) --scenario builtin:eight)": "tests/cli/test_search.py flies two",
    r"arva-hil demo (--count 4|--scenario builtin:eight_drones)$": "tests/cli/test_demo.py flies it, faster",
    r"mkdir .*arva_msgs|cd ~/ros2_ws|ros2 |rviz2 |arva-hil demo --ros2|ARVA_ROS2_PYTHON": "needs ROS 2: "
    "tests/observers/test_foxglove.py, where it is",
    r"python docs/examples/ros_node\.py": "needs ROS; tests/pages/test_tutorial.py runs it with a stand-in",
    r"cc .*example_main\.c": "the tutorial's lines are the same and are typed in test_tutorial.py",
}
KEY = "11" * 32


def reason(command: str) -> str | None:
    """Why a line is not run."""
    return next((why for begins, why in NOT_RUN.items() if re.match(begins, command)), None)


PAGES = {str(page.relative_to(ROOT)): [*shell_lines(page)] for page in pages()}
FIRST = {
    typed.command: typed.place for lines in reversed(PAGES.values()) for typed in reversed(lines)
}  # the rest repeat it


def to_run(typed: Typed) -> bool:
    return reason(typed.command) is None and FIRST[typed.command] == typed.place


class Bench:
    """A folder like this project's, a vehicle and what else a page's lines need. Remembers what is running."""

    def __init__(self, folder: Path, factory: pytest.TempPathFactory) -> None:
        self.folder = folder
        self._factory = factory
        self._user = {"HOME": str(folder), "XDG_STATE_HOME": str(folder), "PATH": "/usr/bin:/bin"}
        self._open: list[Program | PtyLink | Beacon] = []
        for name in ("configs", "docs", "firmware_proto", "tests", "tools"):
            (folder / name).symlink_to(ROOT / name)
        shutil.copy(ROOT / "tests/data/arducopter.tlog", folder / "flight.tlog")
        shutil.copy(ROOT / "configs/default.yaml", folder / "scenario.yaml")
        (folder / ".arva-hil.key").write_text(KEY)
        (folder / ".arva-hil.key").chmod(0o600)
        self._vehicle = [f"pty:{folder}/vehicle-1", f"pty:{folder}/vehicle-2"]

    def start(self, *words: object, **environment: str) -> Program:
        """The program, in this folder, with nothing of the environment of whoever runs the tests."""
        program = Program(*words, env={**self._user, **environment}, cwd=self.folder)
        self._open.append(program)
        return program

    def fly(self, *links: str) -> None:
        """The vehicle, on two pseudo-terminals and on what is named."""
        words = [word for link in (*self._vehicle, *links) for word in ("--link", link)]
        self.start("vehicle", *words).says("on the ground")

    def receive(self) -> None:
        """A receiver on the pseudo-terminal of the pages."""
        self._open.append(Beacon(symlink=f"{self.folder}/arva0"))

    def here(self, words: list[str], vehicle: bool = True) -> list[str]:
        """The words of a line with this bench's places, and the vehicle where the line looks for one."""
        line = PtyLink()
        self._open.append(line)
        places = {"/tmp/": f"{self.folder}/", "/dev/ttyUSB0": line.path, "~/": f"{self.folder}/"}
        places |= {
            "/dev/ttyUSB1": f"{self.folder}/vehicle-1",
            "/dev/serial/by-id/usb-AUTOPILOT": f"{self.folder}/vehicle-1",
        }
        result, links = [], []
        for word in words:
            for there, place in places.items():
                word = word.replace(there, place)
            if address := re.fullmatch(r"(tcp|tcpin|udpin|udpout):[0-9.]+:[0-9]+", word):
                port = free_port(socket.SOCK_STREAM if "tcp" in word else socket.SOCK_DGRAM)
                word = f"{address[1]}:127.0.0.1:{port}"
                if result[-1] == "--autopilot":
                    links.append({"tcp": "tcpin", "udpin": "udpout"}[address[1]] + f":127.0.0.1:{port}")
            result.append(word)
        if vehicle:
            self.fly(*links)
        return result

    def ends(self, *words: object, codes: tuple[int, ...] = (0,), **environment: str) -> None:
        """A command that ends by itself, and well: in this process, unless it is that of an installed wheel."""
        if UNDER_TEST:
            program = self.start(*words, **environment)
            program.ends(*codes)
            return
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(self.folder)
            for name in [name for name in os.environ if name.startswith("ARVA_HIL_")]:
                patch.delenv(name)
            for name, value in {**self._user, **environment}.items():
                patch.setenv(name, value)
            patch.setattr(range_test, "_PASSES", 2)  # of the flights along strips
            with undrawn():
                assert main([str(word) for word in words]) in codes

    def record(self, *demo: str) -> None:
        """What a demonstration records in the folder that is named last: flown once, then copied."""
        *options, folder = demo
        if options == ["--speed", "max", "--record"] and not UNDER_TEST:
            record = flown.demo(self._factory).record
        else:
            name = "".join(options)
            few = {"codes": (0, 1), "ARVA_HIL_LIMIT": "10"}  # seconds of the search
            record = (
                once(self._factory, name, lambda made: self.ends("demo", *options, made / "record", **few)) / "record"
            )
        shutil.copytree(record, self.folder / folder)

    def clear(self) -> None:
        """Nothing runs any more."""
        while self._open:
            self._open.pop().close()


@pytest.fixture
def bench(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    bench = Bench(tmp_path, tmp_path_factory)
    yield bench
    bench.clear()


@pytest.mark.parametrize("page", [page for page, lines in PAGES.items() if any(map(to_run, lines))])
def test_the_lines_of_a_page_do_what_they_are_there_for(page: str, bench: Bench) -> None:
    for typed in PAGES[page]:
        if to_run(typed):
            run(typed, bench)
            bench.clear()


def test_every_reason_is_that_of_a_line() -> None:
    lines = [typed.command for page in PAGES.values() for typed in page]
    assert [begins for begins in NOT_RUN if not any(re.match(begins, line) for line in lines)] == []


def run(typed: Typed, bench: Bench) -> None:
    """Run one line, and see that it does what it is there for."""
    words = shlex.split(typed.command)
    environment = dict(word.split("=", 1) for word in words if re.match(r"ARVA_HIL_\w+=", word))
    words = words[len(environment) :]
    if words[:1] == ["python"]:
        answers_to_its_options(words[1:])
        return
    assert words[0] == "arva-hil", f"{typed.place}: {typed.command}: run it, or say in NOT_RUN why it is not"
    command = "run" if words[1].startswith("-") and words[1] != "--help" else words[1]
    ways: dict[str, Callable[[list[str], Bench, dict[str, str]], None]] = {
        "run": runs,
        "search": searches,
        "listen": listens,
        "command": asks,
        "doctor": examines,
        "vehicle": flies,
        "view": views,
        "demo": shows,
    }
    if "--record" not in words:
        for word in words:
            if re.fullmatch(r"flights/\d+", word) and not (bench.folder / word).exists():
                bench.record("--speed", "max", "--record", word)
    try:
        ways.get(command, ends)(words[1:], bench, environment)
    except AssertionError as error:
        raise AssertionError(f"{typed.place}: {typed.command}\n{error}") from error


def answers_to_its_options(words: list[str]) -> None:
    """A tool that runs for minutes or hours: it is there, and has these options. It tells them in this process."""
    count = 2 if words[0] == "-m" else 1
    told = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(told):
        patch.setattr(sys, "argv", [words[count - 1], "--help"])
        patch.delitem(sys.modules, f"{words[count - 1]}.__main__", raising=False)  # another test imported it
        start = runpy.run_module if count == 2 else runpy.run_path
        with pytest.raises(SystemExit, match=r"^0$"):
            start(words[1] if count == 2 else str(ROOT / words[0]), run_name="__main__")
    assert [word for word in words[count:] if word.startswith("-") and word not in told.getvalue()] == []


def runs(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    live = {"--autopilot", "--record"} & set(words)
    words = bench.here(words, vehicle=bool(live))
    if not live:
        environment |= {"ARVA_HIL_AUTOPILOT": "pty", "ARVA_HIL_DURATION": "0.01"}
        bench.ends(*words, codes=(3,), **environment)
        return
    if "--autopilot" not in words:
        environment["ARVA_HIL_AUTOPILOT"] = f"{bench.folder}/vehicle-1"
    program = bench.start(*words, **environment)
    if "--signing-key" in words:
        program.says("not signed|unsigned")  # the vehicle signs nothing, and so it is not believed
        program.send(signal.SIGINT)
        program.ends(3, 130)
        return
    program.says("readings are real")
    program.stops()


def searches(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    words = bench.here(words)
    bench.receive()
    program = bench.start(*words, **environment)
    if "--dry-run" in words:
        program.says("it would have flown")
        program.ends()
        return
    program.says("arming")
    program.stops()


def listens(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    words = bench.here(words, vehicle=False)
    if (bench.folder / words[-1]).is_file():
        ends(words, bench, environment)
        return
    bench.receive()
    program = bench.start(*words, **environment)
    program.writes(20)
    program.stops()


def asks(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    words = bench.here(words)
    emulator = bench.start("--autopilot", f"{bench.folder}/vehicle-2", "--port", f"pty:{bench.folder}/arva0")
    emulator.says("readings are real")
    program = bench.start(*words, "--timeout", "30", **environment)
    program.ends()
    assert b": done" in program.out


def views(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    if "--out" in words:
        bench.ends(*words, **environment)
        return
    program = bench.start(*words, **environment)
    program.says("page: http://")
    program.stops()


def shows(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    assert (words[-2], environment) == ("--record", {})
    bench.record(*words[1:])


def flies(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    program = bench.start(*bench.here(words, vehicle=False), **environment)
    program.says("on the ground")
    program.stops()


def examines(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    """Nobody reads the frames on this bench, which is what `doctor` finds in the end."""
    environment |= {"ARVA_HIL_LISTEN": "2", "ARVA_HIL_AUTOPILOT": f"{bench.folder}/vehicle-1"}
    program = bench.start(*bench.here(words), **environment)
    program.ends(0, 1)
    assert b"position" in program.out


def ends(words: list[str], bench: Bench, environment: dict[str, str]) -> None:
    """A command that ends by itself, and well. A campaign lists its trials, a range test walks twice."""
    found = [sorted(map(str, bench.folder.glob(word))) if "*" in word else [word] for word in words]
    words = [word for several in found for word in several]
    shorter = {"campaign": ["--dry-run"], "range-test": ["--walks", "2"]}
    bench.ends(*words, *shorter.get(words[0], []), **environment)
