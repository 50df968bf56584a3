"""A bench: frames without waiting, truth without the wire, faults, a plug, and nothing left behind."""

from __future__ import annotations

import os
import threading
from contextlib import closing
from io import BufferedReader
from pathlib import Path

import pytest
from serial import SerialException

from arva_hil import Bench, BenchError, LinkError
from arva_hil.clock import StepClock
from arva_hil.links import memory, open_link
from arva_hil.mavlink.codec import Parser
from firmware_proto import Command, Decoder
from firmware_proto.commands import encode_command
from tests.every import every


@every("port", ["pty", "tcp", "memory"])
def test_the_wire_carries_the_frames_that_the_bench_names(port: str) -> None:
    with Bench(port=port) as bench:
        serial = bench.serial()
        made = bench.advance(30)
        assert [one.frame for one in made] == Decoder().feed(serial.read(4096), 0.0)
        assert [one.instant_s for one in made] == [float(n) for n in range(30)]
        assert bench.now() == 30.0


def test_thirty_seconds_in_small_steps_are_the_same_frames() -> None:
    with Bench(port="memory") as whole, Bench(port="memory") as parts:
        assert parts.advance(0) == []
        for _ in range(300):
            parts.advance(0.1)
        assert [one.frame for one in parts.frames] == [one.frame for one in whole.advance(30)]


def test_the_truth_is_where_the_vehicle_was_put_also_far_away() -> None:
    with Bench(port="memory") as bench:
        assert bench.truth().ned == (0.0, 0.0, -3.0)
        bench.place_vehicle(15, 5, -2, yaw=90)
        (made,) = bench.advance(1)
        truth = bench.truth()
        assert truth.ranges_m == {1: pytest.approx(29**0.5)}
        assert truth.yaw_deg == pytest.approx(90)
        assert made.frame.channels[0].d == pytest.approx(100 * 29**0.5, rel=0.17)
        bench.place_vehicle(5000, 0, -2)
        (made,) = bench.advance(1)
        assert made.pose is not None
        assert made.pose.position == pytest.approx([5000, 0, -2], abs=0.1)
        assert not made.frame.channels[0].valid


def test_it_flies_from_point_to_point_and_stays() -> None:
    with Bench(port="memory") as bench:
        bench.advance(2.5)
        bench.fly([(0, 0, 0, -3), (4, 8, 0, -3), (6, 8, 4, -3, 90)])
        made = bench.advance(8)
        places = [one.pose.position.tolist() for one in made if one.pose]
        for number, place in {0: [1, 0, -3], 5: [8, 3, -3], 7: [8, 4, -3]}.items():
            assert places[number] == pytest.approx(place, abs=0.02)
        assert bench.truth().yaw_deg == pytest.approx(90)


def test_faults_come_and_go_and_strike_the_same_frames_each_time() -> None:
    runs = []
    for _ in range(2):
        with Bench(port="memory") as bench:
            bench.advance(3)
            bench.inject("drop=0.5")
            bench.inject("transmitter_fading=1,over_s=10")
            sent = [one.sent for one in bench.advance(20)]
            assert 4 < sum(sent) < 16
            assert not bench.advance(1)[0].frame.channels[0].valid
            bench.clear()
            after = bench.advance(20)
            assert all(one.sent and one.frame.channels[0].valid for one in after)
            runs.append((sent, [one.frame for one in after]))
    assert runs[0] == runs[1]


def test_a_plug_is_pulled_and_put_back_and_the_switch_is_turned() -> None:
    with Bench() as bench:
        port, serial = bench.port, bench.serial()
        bench.advance(2)
        bench.unplug()
        with pytest.raises(SerialException):
            serial.read(1000) and serial.read(1000)
        assert not os.path.exists(port)
        bench.advance(3)
        bench.replug()
        assert bench.port == port
        serial = bench.serial()
        made = bench.advance(1)
        assert Decoder().feed(serial.read(100), 0.0) == [made[0].frame]
        assert made[0].frame.sequence == 5
        bench.power_cycle()
        assert [one.frame.sequence for one in bench.advance(2)] == [0, 1]
        assert bench.counters.dropped == 3


def test_a_read_that_waits_lets_virtual_time_pass() -> None:
    with Bench(port="memory") as bench:
        serial = bench.serial(timeout=2.5)
        assert len(serial.read(66)) == 66
        assert bench.now() == pytest.approx(1.0, abs=0.001)
        bench.inject("silence")
        assert serial.read(1) == b""
        assert bench.now() == pytest.approx(3.5, abs=0.001)
        bench.unplug()
        with pytest.raises(SerialException):
            serial.read(1)


def test_frames_go_out_over_udp_and_the_far_end_is_the_programs_own() -> None:
    with Bench(port="udp") as bench, closing(open_link(bench.port, clock=StepClock())) as far:
        with pytest.raises(BenchError, match=r"udpin:.* is not at this end: open the far end yourself"):
            bench.serial()
        made = bench.advance(3)
        assert [one.frame for one in made] == Decoder().feed(far.read(), 0.0)


def test_a_port_in_memory_is_read_as_pyserial_s_own() -> None:
    with Bench("builtin:default", port="memory") as bench:
        serial = bench.serial(timeout=0)
        assert serial.is_open
        bench.advance(2)
        assert serial.in_waiting == 66
        (one,) = Decoder().feed(BufferedReader(serial, 33).read(33), 0.0)
        assert one == bench.frames[0].frame
        bench.advance(1)
        serial.reset_input_buffer()
        assert serial.in_waiting == 0
        bench.unplug()
        with pytest.raises(SerialException, match="unplugged"):
            serial.read()
        with pytest.raises(SerialException, match="unplugged"):
            serial.write(b"x")
        bench.replug()
        assert serial.write(b"x") == 1
    assert not serial.is_open


def test_a_clock_is_virtual_or_real() -> None:
    with pytest.raises(BenchError, match="clock: 'fast', expected 'virtual' or 'real'"):
        Bench(clock="fast")  # type: ignore[arg-type]


def test_a_command_of_the_host_is_answered() -> None:
    with Bench(port="memory") as bench:
        bench.serial().write(encode_command(Command(7, "channels", (2,))))
        assert [len(one.frame.channels) for one in bench.advance(3)][-1] == 2


def test_in_real_time_frames_come_by_themselves_and_advance_is_refused() -> None:
    with Bench(port="memory", clock="real") as bench:
        assert len(bench.serial(timeout=5).read(33)) == 33
        with pytest.raises(BenchError, match="advance: this bench has a real clock"):
            bench.advance(1)
        assert bench.truth().ned == (0.0, 0.0, -3.0)
    assert "arva-bench" not in [one.name for one in threading.enumerate()]


def test_the_built_in_vehicle_can_be_flown_over_a_link_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    near, far = memory.pair()
    monkeypatch.setattr("arva_hil.bench.bench.open_link", lambda address, clock: near)
    with Bench(port="memory", autopilot="tcpin:127.0.0.1:5760") as bench:
        assert bench.advance(5)[-1].pose is not None
        assert Parser().feed(far.read())
        with pytest.raises(BenchError, match="flies itself"):
            bench.place_vehicle(0, 0, 0)


@every(
    "call, message",
    [
        (lambda bench: bench.inject("dorp=0.3"), "did you mean 'drop'"),
        (lambda bench: bench.inject("transmitter_off=9"), "expected one of 1"),
        (lambda bench: bench.advance(-1), "advance: -1"),
        (lambda bench: bench.advance(float("nan")), "advance: nan"),
        (lambda bench: bench.place_vehicle(float("nan"), 0, 0), "place_vehicle: nan, expected"),
        (lambda bench: bench.place_vehicle(0, 10**400, 0), "place_vehicle: 1000"),
        (lambda bench: bench.fly([(0, 0, 0, -1), (1, 0, 0, 1e308)]), "fly: 1e"),
        (lambda bench: bench.fly([(10**400, 0, 0, -1)]), "fly: 1000"),
        (lambda bench: bench.fly([(0, 1)]), "each point"),
        (lambda bench: bench.fly([(1, 0, 0, 0), (1, 0, 0, 0)]), "later time"),
        (lambda bench: bench.fly([]), "a path needs points"),
    ],
)
def test_a_mistake_of_the_test_is_named_and_changes_nothing(call: object, message: str) -> None:
    with Bench(port="memory") as bench:
        with pytest.raises(ValueError, match=message):
            call(bench)  # type: ignore[operator]
        assert bench.truth().ned == (0.0, 0.0, -3.0)
        assert bench.now() == 0.0
        assert bench.advance(1)[0].sent


def test_a_scenario_with_several_vehicles_is_refused() -> None:
    with pytest.raises(BenchError, match="one vehicle"):
        Bench("builtin:eight_drones")


def test_nothing_is_left_of_a_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def left() -> tuple[int, int, int]:
        return len(os.listdir("/proc/self/fd")), threading.active_count(), len(os.listdir(tmp_path))

    before = left()
    for n in range(10):
        with Bench(port=("pty", "tcp", "memory")[n % 3]) as bench:
            bench.serial()
            bench.advance(1)
            if n % 2:
                bench.unplug()
    bench.close()
    with pytest.raises(LinkError):
        Bench(port="/dev/none")
    assert left() == before
