"""The wire on a real core: an STM32F405, emulated by QEMU, reads what `arva-hil` writes to its serial port."""

from __future__ import annotations

import re
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

import firmware_proto
from arva_hil.cli.main import main
from arva_hil.links.serial import open_serial
from firmware_proto import Decoder, Frame

FOLDER = Path(firmware_proto.__file__).parent / "c"
COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
DEADLINE_S = 30.0
TEST = Path(__file__).parents[2] / "docs" / "examples" / "driver" / "test_board.py"
LOG = Path(__file__).parents[1] / "data" / "px4.tlog"
PACKAGES = "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"

MISSING = [tool for tool in (COMPILER, EMULATOR) if not shutil.which(tool)]


class Board:
    """The board while it runs: `port` is its USART1, `says` waits for what it says on its USART2, its `out`."""

    def __init__(self, program: Path, out: str = "stdio") -> None:
        command = [EMULATOR, "-M", "netduinoplus2", "-display", "none", "-monitor", "none"]
        command += ["-serial", "pty", "-serial", out, "-kernel", str(program)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        self.said = ""
        self.port = self.says(r"redirected to (\S+).*\n")[1]
        if out == "stdio":
            self.says("ready\r\n")

    def says(self, pattern: str) -> re.Match[str]:
        assert self._process.stdout is not None
        while not (found := re.search(pattern, self.said)):
            assert select.select([self._process.stdout], [], [], DEADLINE_S)[0], f"silence behind {self.said[-200:]!r}"
            self.said += self._process.stdout.read1().decode()
        return found

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example as its README has it built, for QEMU's clock."""
    if MISSING:
        pytest.skip(f"no {' and no '.join(MISSING)}; on Debian: apt-get install {PACKAGES}")
    built = tmp_path_factory.mktemp("stm32f405") / "arva.elf"
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"(?m)^(arm-none-eabi-gcc (?:.*\\\n)*.*)", page)
    words = line.replace("\\\n", " ").split()
    words[words.index("-o") + 1] = str(built)
    subprocess.run([*words, "-Wextra", "-Werror", "-Wl,--fatal-warnings"], cwd=FOLDER, check=True, timeout=DEADLINE_S)
    return built


@pytest.fixture
def board(program: Path) -> Iterator[Board]:
    board = Board(program)
    yield board
    board.close()


def answer(frame: Frame) -> str:
    heard = [f" {c.id}:{c.d}:{c.delta}" for c in frame.channels if c.d > 0]
    return f"{frame.sequence}{''.join(heard)}\r\n"


def answers(data: bytes) -> list[str]:
    decoder = Decoder()
    return [answer(frame) for frame in decoder.feed(data, 0.0) + decoder.feed(b"", 1.0)]


def test_every_frame_at_50_hz_is_answered_with_its_d_and_delta(board: Board, tmp_path: Path) -> None:
    """Of those that were damaged on their way, just those that Python's decoder takes."""
    record, flight = tmp_path / "record", tmp_path / "eighth.tlog"
    flight.write_bytes(LOG.read_bytes()[: LOG.stat().st_size // 8])
    options = ["--rate", "50", "--speed", "2", "--record", str(record)]
    for fault in ("corrupt=0.2", "truncate=0.1", "drop_bytes=0.005", "insert_bytes=0.005"):
        options += ["--fault", fault]
    assert main(["replay", str(flight), "--port", board.port, *options]) == 0
    expected = answers((record / "frames.bin").read_bytes())
    assert len(expected) > 50
    board.says(re.escape(expected[-1]))
    assert board.said.partition("ready\r\n")[2].removesuffix("lost\r\n") == "".join(expected)


def test_a_line_that_falls_silent_is_said_to_be_lost_once(board: Board) -> None:
    with closing(open_serial(board.port)) as line:
        line.write(firmware_proto.encode(Frame(7, 0, (firmware_proto.Channel(1, 0, 1234, -17),))))
        board.says("7 1:1234:-17\r\nlost\r\n")
        line.write(firmware_proto.encode(Frame(8, 0, (firmware_proto.Channel(2, 2, 150, 0),))))
        board.says("lost\r\n8 2:150:0\r\nlost\r\n")


def run_example(folder: Path, level: int, **places: str) -> None:
    """Run the page's test as its docstring says, with these places for those in it."""
    line = [line for line in TEST.read_text(encoding="utf-8").splitlines() if line.startswith("DEVICE=")][level]
    for name, place in {"python": sys.executable, "test_board.py": str(TEST), **places}.items():
        line = line.replace(name, place)
    line += " -p no:cacheprovider"
    ran = subprocess.run(["bash", "-c", line], cwd=folder, capture_output=True, text=True, timeout=4 * DEADLINE_S)
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_the_test_of_the_page_passes_with_a_program_on_this_computer(tmp_path: Path) -> None:
    sources = [FOLDER / "example_main.c", FOLDER / "arva_frame.c"]
    subprocess.run(["cc", "-std=c99", *sources, "-o", tmp_path / "example"], check=True, timeout=DEADLINE_S)
    run_example(tmp_path, 0)


def test_the_same_test_passes_with_the_board_in_qemu(program: Path) -> None:
    run_example(program.parent, 1)


def test_the_same_test_passes_with_a_board_on_two_ports(program: Path) -> None:
    with closing(Board(program, "pty")) as board:
        out = board.says(r"redirected to (\S+) \(label serial1")[1]
        run_example(program.parent, 2, **{"/dev/ttyUSB0": board.port, "/dev/ttyUSB1": out})
