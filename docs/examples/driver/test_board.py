"""One test on three levels: a program on this computer, a board in QEMU, a board on two serial ports.

DEVICE=./example python -m pytest test_board.py
DEVICE="qemu-system-arm -M netduinoplus2 -display none -serial pty -serial stdio -kernel arva.elf" python -m pytest test_board.py
DEVICE=/dev/ttyUSB1 python -m pytest test_board.py --arva-port /dev/ttyUSB0

The device reads frames, and answers each with a line: the sequence number, then id, d and δ of each channel with a signal.
"""  # noqa: E501

import os
import re
import select
import shlex
import subprocess
from collections.abc import Callable, Iterator
from typing import IO, Any

import pytest
from serial import Serial

from arva_hil import Bench

DEVICE = os.environ.get("DEVICE", "./example")
SILENCE_S = 10.0


def read_line(out: Any) -> str:
    line = b""
    while not line.endswith(b"\n"):
        assert select.select([out], [], [], SILENCE_S)[0], f"the device is silent after {line!r}"
        line += out.read(1)
    return line.decode()


@pytest.fixture
def device(arva_bench_factory: Callable[..., Bench]) -> Iterator[tuple[Bench, Serial | IO[bytes]]]:
    if DEVICE.startswith("/dev/"):
        with Serial(DEVICE, 115200) as out:
            yield arva_bench_factory(), out
        return
    words = shlex.split(DEVICE)
    emulated = words[0].startswith("qemu")
    bench = None if emulated else arva_bench_factory()
    command = words if bench is None else [*words, bench.port]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, bufsize=0) as program:
        assert program.stdout is not None
        try:
            if bench is None:
                (port,) = re.findall(r"redirected to (\S+)", read_line(program.stdout))
                bench = arva_bench_factory(port=port)
                assert "ready" in read_line(program.stdout)
            yield bench, program.stdout
        finally:
            program.kill()


def test_each_frame_is_answered_with_d_and_delta(device: tuple[Bench, Any]) -> None:
    bench, out = device
    bench.place_vehicle(north=15, east=5, down=-2, yaw=30)
    frames = bench.advance(3)
    bench.inject("transmitter_off=1")
    for made in [*frames, *bench.advance(2)]:
        heard = [number for c in made.frame.channels if c.valid for number in (c.id, c.d, c.delta)]
        answer = read_line(out).rpartition("frame ")[2]
        assert [int(number) for number in re.findall(r"-?\d+", answer)] == [made.frame.sequence, *heard]
