"""What measurements mean: each finding by tables, how they add up to an exit code and a verdict."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from arva_hil.cli.diagnosis import diagnosis
from arva_hil.cli.diagnosis.diagnosis import Finding, PortTraffic, Source, StreamRate, Traffic
from arva_hil.links.serial_ports import SerialPort

PILOT = Source(1, 1, "ardupilotmega quadrotor", True, 6, 1.0)
OTHER = Source(2, 1, "px4 quadrotor", True, 6, 1.0)
STATION = Source(255, 190, "gcs", False, 6, 1.0)
CLEAN = Traffic(seconds=6.0, size=12_000, packets=600, old=0, signed=0, bad=0)
TRAFFIC = PortTraffic("serial", "/dev/ttyUSB0", 12, 0)
PLACE = (46.0123, 7.7456, 1650.0)


def both(cure: str) -> bool:
    """Whether it helps with either autopilot."""
    return "ArduPilot: " in cure and "PX4: " in cure


# -- the autopilot's link ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "cure"),
    [
        ("serial", "SERIALn_PROTOCOL 2"),
        ("udpin", "14030 at 8 Hz"),
        ("udpin", "udpin:127.0.0.1:14445"),
        ("udpout", "MAV_n_UDP_PRT"),
        ("tcp", "each port has one client"),
        ("tcpin", "TCP client"),
        ("pyserial", "SERIALn_BAUD"),
    ],
)
def test_silence_has_a_cure_for_each_kind_of_link(kind: str, cure: str) -> None:
    finding = diagnosis.silence(kind, 6.0)
    assert (finding.check, finding.state, finding.found) == ("bytes", "fail", "no byte came in 6.0 s")
    assert cure in finding.cure
    assert both(finding.cure)


@pytest.mark.parametrize(
    ("accepted", "found", "cure", "never"),
    [
        (True, "is accepted, but nothing is sent", "SERIALn_PROTOCOL 2", "another client"),
        (False, "another client has the port", "take another one", "SERIALn_PROTOCOL"),
    ],
)
def test_a_port_that_is_not_mavlink_is_told_from_one_that_another_client_has(
    accepted: bool, found: str, cure: str, never: str
) -> None:
    finding = diagnosis.silence("tcp", 6.0, accepted=accepted)
    assert found in finding.found
    assert cure in finding.cure
    assert never not in finding.found + finding.cure
    assert both(finding.cure)


def test_a_far_machine_that_refuses_is_named() -> None:
    assert diagnosis.silence("udpout", 6.0, refused=True).found.endswith("no program listens there")


@pytest.mark.parametrize(
    ("sample", "found"),
    [
        (bytes(n * 7 % 251 for n in range(100)), "none in 100 bytes"),
        (b"", "none in 100 bytes"),
        (b"\x81$G\xb5\x62\x99", "none in 100 bytes"),
        (b"xx\xa4\x57\x01\x1b", "none in 100 bytes, but frames of a receiver"),
        (b"\xb5\x62\x01\x07", "none in 100 bytes, but u-blox: a GPS receiver"),
        (b"$GNGGA,1,2", "none in 100 bytes, but NMEA: a GPS receiver"),
        (b"\r\nnsh> ", "none in 100 bytes, but PX4's shell"),
        (b"Init ArduCopter\r\n\r\nFree RAM: 1234", "but plain text: 'Init ArduCopter Free RAM: 1234'"),
    ],
)
def test_bytes_that_are_no_packets_are_recognised(sample: bytes, found: str) -> None:
    finding = diagnosis.garbage("serial", 100, sample)
    assert (finding.check, finding.state) == ("packets", "fail")
    assert found in finding.found
    assert ("but" in finding.found) == ("but" in found)
    assert both(finding.cure)


def test_the_baud_rate_that_works_is_the_cure() -> None:
    finding = diagnosis.baud("/dev/ttyACM0", (115200, 57600), 57600)
    assert finding == ("baud", "fail", "57600 brings packets, 115200 does not", "--autopilot /dev/ttyACM0,57600")


def test_no_baud_rate_works() -> None:
    finding = diagnosis.baud("/dev/ttyACM0", (115200, 57600), None)
    assert (finding.state, finding.found) == ("fail", "no MAVLink at 115200, 57600")
    assert finding.cure.startswith("the port's protocol is probably not MAVLink")


@pytest.mark.parametrize(
    ("traffic", "state", "found"),
    [
        (CLEAN, "ok", "600 in 6.0 s, 2.0 kB/s, MAVLink 2, no bad checksums"),
        (replace(CLEAN, old=600), "ok", "MAVLink 1, no bad"),
        (replace(CLEAN, old=7), "ok", "MAVLink 2, 7 of them MAVLink 1, no bad"),
        (replace(CLEAN, bad=2), "ok", "0.3% bad checksums"),
        (replace(CLEAN, packets=2, bad=2), "ok", "50.0% bad checksums"),  # the beginning of a stream
        (replace(CLEAN, bad=200), "note", "25.0% bad checksums"),
    ],
)
def test_packets(traffic: Traffic, state: str, found: str) -> None:
    finding = diagnosis.packets(traffic)
    assert (finding.check, finding.state) == ("packets", state)
    assert found in finding.found
    assert both(finding.cure) == (state == "note")


def test_signing() -> None:
    assert diagnosis.signing(CLEAN) == ("signing", "ok", "not signed", "")
    finding = diagnosis.signing(replace(CLEAN, signed=600))
    assert finding.state == "note"
    assert finding.found.startswith("600 of 600 packets are signed")
    assert both(finding.cure)


@pytest.mark.parametrize(
    ("refused", "state", "found"),
    [
        ({"unsigned": 0, "forged": 0}, "ok", "all 600 packets are signed with the key"),
        ({"unsigned": 5, "forged": 0}, "note", "595 of 600 packets are signed with the key; ignored: 5 unsigned"),
        ({"unsigned": 599, "forged": 1}, "fail", "every packet is ignored: 599 unsigned, 1 forged"),
    ],
)
def test_signing_with_a_key(refused: dict[str, int], state: str, found: str) -> None:
    finding = diagnosis.signing(replace(CLEAN, signed=600, refused=refused))
    assert (finding.state, finding.found) == (state, found)
    assert both(finding.cure) == (state == "fail")
    assert diagnosis.exit_code([finding]) == (3 if state == "fail" else 0)


def test_strangers() -> None:
    assert diagnosis.other_senders(0, "") is None
    finding = diagnosis.other_senders(7, "10.0.0.9:5555")
    assert finding is not None
    assert (finding.state, finding.found) == (
        "note",
        "7 datagrams of other senders are ignored; the first was from 10.0.0.9:5555",
    )


@pytest.mark.parametrize(
    ("sources", "followed", "target", "state", "found", "cure"),
    [
        ([PILOT], (1, 1), (None, None), "ok", "ardupilotmega quadrotor 1/1 ×6 at 1.0 Hz is followed", ""),
        ([PILOT, STATION], (1, 1), (None, None), "ok", "is followed; also gcs 255/190 ×6 at 1.0 Hz", ""),
        ([PILOT, OTHER], (2, 1), (None, None), "note", "px4 quadrotor 2/1", "--target-system 1 or --target-system 2"),
        ([PILOT, OTHER], (2, 1), (2, None), "ok", "px4 quadrotor 2/1", ""),
        ([], None, (None, None), "fail", "none from anybody", "forward HEARTBEAT"),
        ([STATION], None, (None, None), "fail", "none from an autopilot, only gcs 255/190", "forward the vehicle here"),
        ([PILOT], None, (7, None), "fail", "none from 7/1, but ardupilotmega", "--target-system 1"),
        ([replace(PILOT, component=9)], None, (None, None), "fail", "none from any/1", "--target-component 9"),
        ([replace(PILOT, hz=0.3)], (1, 1), (None, None), "note", "at 0.3 Hz", "loses packets"),
        ([replace(PILOT, count=1, hz=None)], (1, 1), (None, None), "ok", "×1 is followed", ""),
    ],
)
def test_heartbeats(
    sources: list[Source],
    followed: tuple[int, int] | None,
    target: tuple[int | None, int | None],
    state: str,
    found: str,
    cure: str,
) -> None:
    finding = diagnosis.heartbeat(sources, followed, target)
    assert (finding.check, finding.state) == ("heartbeat", state)
    assert found in finding.found
    assert cure in finding.cure
    assert bool(cure) == bool(finding.cure)


# -- the pose ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["GLOBAL_POSITION_INT", "ATTITUDE"])
@pytest.mark.parametrize(
    ("count", "hz", "said", "state", "found"),
    [
        (300, 49.6, "", "ok", "49.6 Hz, 50 were asked for"),
        (300, 35.1, "", "ok", "35.1 Hz"),
        (60, 10.2, "SET_MESSAGE_INTERVAL: never answered", "note", "10.2 Hz, 50 were asked for (SET_MESSAGE"),
        (60, 0.0, "", "fail", "60 came, none in the last 2 s"),
        (0, 0.0, "SET_MESSAGE_INTERVAL: MAV_RESULT_DENIED ×3", "fail", "none came (SET_MESSAGE_INTERVAL: MAV_RESULT_D"),
    ],
)
def test_streams(name: str, count: int, hz: float, said: str, state: str, found: str) -> None:
    finding = diagnosis.stream(StreamRate(name, count, hz, 50.0, said))
    assert (finding.check, finding.state) == (name, state)
    assert found in finding.found
    assert both(finding.cure) == (state != "ok")


def test_a_position_that_is_promised_and_silent_waits_for_a_fix() -> None:
    position, attitude = (StreamRate(name, 0, 0.0, 50.0, promised=True) for name in ("GLOBAL_POSITION_INT", "ATTITUDE"))
    assert "PX4 sends no position before it has one" in diagnosis.stream(position).cure
    assert "before it has one" not in diagnosis.stream(attitude).cure


def test_a_log_is_not_measured_by_what_nobody_asked_of_it() -> None:
    assert diagnosis.stream(StreamRate("ATTITUDE", 9, 4.0, 50.0, recorded=True))[1:] == (
        "ok",
        "4.0 Hz, as recorded",
        "",
    )


@pytest.mark.parametrize(
    ("position", "state", "found"),
    [
        ((PLACE, 3, 0), "ok", "46.0123000, 7.7456000, 1650.0 m AMSL"),
        ((PLACE, 0, 0, "GPS 3d_fix, 9 satellites"), "ok", "AMSL, GPS 3d_fix, 9 satellites"),
        ((None, 3, 0, "GPS no_fix, 2 satellites"), "fail", "all zeros in 3 messages: no GPS fix yet, GPS no_f"),
        ((None, 0, 4), "fail", "out of range in 4 messages"),
        ((None, 0, 0), "fail", "unknown: no GLOBAL_POSITION_INT came"),
    ],
)
def test_position(position: tuple[Any, ...], state: str, found: str) -> None:
    finding = diagnosis.position(*position)
    assert (finding.check, finding.state) == ("position", state)
    assert found in finding.found
    assert bool(finding.cure) == (state == "fail")


def test_home() -> None:
    assert diagnosis.home(PLACE, armed=True) == ("home", "ok", "46.0123000, 7.7456000, 1650.0 m AMSL, armed", "")
    finding = diagnosis.home(None, armed=False)
    assert finding[:3] == ("home", "note", "not known yet, not armed")
    assert both(finding.cure)


@pytest.mark.parametrize(("age_s", "state"), [(0.012, "ok"), (2.0, "ok"), (2.1, "fail"), (None, "fail")])
def test_pose(age_s: float | None, state: str) -> None:
    assert diagnosis.pose(age_s).state == state


@pytest.mark.parametrize(
    ("lags_s", "reboots", "state", "found"),
    [
        ([0.0] * 95 + [0.01] * 4 + [0.05], 0, "ok", "up to 50 ms later than the quickest, 95 % within 0 ms"),
        ([0.0] * 5 + [0.5] * 5, 0, "note", "95 % within 500 ms"),
        ([0.0], 0, "ok", "up to 0 ms"),
        ([], 0, "note", "no boot time came"),
        ([0.0], 2, "note", "boot time went back 2 ×"),
    ],
)
def test_clock(lags_s: list[float], reboots: int, state: str, found: str) -> None:
    finding = diagnosis.clock(lags_s, reboots)
    assert (finding.check, finding.state) == ("clock", state)
    assert found in finding.found


@pytest.mark.parametrize(
    ("times", "now", "hz"),
    [
        ([], 9.0, 0.0),
        ([9.0], 9.5, 0.0),
        ([8.0, 8.5, 9.0], 9.0, 2.0),
        ([8.0, 8.5, 9.0], 9.5, 2 / 1.5),  # a stream that stops slows down
        ([1.0, 2.0, 3.0], 9.0, 0.0),
        ([0.0, 0.1, 8.0, 9.0], 9.0, 1.0),  # only lately
    ],
)
def test_rate(times: list[float], now: float, hz: float) -> None:
    assert diagnosis.rate(times, now) == pytest.approx(hz)


# -- the port ------------------------------------------------------------------------------------------------


def test_no_port_lists_the_candidates() -> None:
    finding = diagnosis.no_port([SerialPort("/dev/ttyS0"), SerialPort("/dev/ttyUSB3", vid=1, pid=2)])
    assert finding[:3] == ("port", "note", "none was named; free: /dev/ttyS0, /dev/ttyUSB3")
    assert finding.cure == "--port /dev/ttyUSB3, --port pty, or --format tunnel"


def test_no_port_is_proposed_that_is_not_there() -> None:
    assert diagnosis.no_port([]) == (
        "port", "note", "none was named; no serial port is free for it", "--port pty, or --format tunnel",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("traffic", "state", "found"),
    [
        (TRAFFIC, "ok", "12 of 12 binary frames were accepted"),
        (replace(TRAFFIC, dropped=3), "note", "12 of 15"),
        (replace(TRAFFIC, taken=0, dropped=12), "fail", "0 of 12"),
        (replace(TRAFFIC, kind="tcpin", taken=0, dropped=12), "fail", "0 of 12"),
        (replace(TRAFFIC, lost="/dev/ttyUSB0: lost: Input/output error"), "fail", "/dev/ttyUSB0: lost"),
    ],
)
def test_frames(traffic: PortTraffic, state: str, found: str) -> None:
    finding = diagnosis.frames(traffic, "binary")
    assert (finding.check, finding.state) == ("frames", state)
    assert found in finding.found
    assert bool(finding.cure) == (state != "ok")


@pytest.mark.parametrize(
    ("traffic", "state", "found"),
    [
        (TRAFFIC, "note", "unknown"),
        (replace(TRAFFIC, answered=4), "ok", "4 bytes came back"),
        (replace(TRAFFIC, seen=("cat",)), "ok", "cat has the other end"),
        (replace(TRAFFIC, kind="mavlink"), "note", "unknown"),
        (replace(TRAFFIC, kind="udpout"), "note", "unknown"),
        (replace(TRAFFIC, kind="udpout", refused=True), "fail", "no program listens there"),
        (replace(TRAFFIC, kind="udpin"), "ok", "a datagram came"),
        (replace(TRAFFIC, kind="tcp"), "ok", "connected"),
        (replace(TRAFFIC, kind="tcpin"), "ok", "connected"),
        (replace(TRAFFIC, kind="pty"), "ok", "a program reads it"),
        (replace(TRAFFIC, kind="pty", unread=99), "note", "no program has it open"),
        (replace(TRAFFIC, kind="pty", seen=("7 (cat)",)), "ok", "7 (cat) reads it"),
        (replace(TRAFFIC, kind="pty", seen=("7 (cat)",), unread=99), "note", "7 (cat) has it open and left 99 bytes"),
    ],
)
def test_reader(traffic: PortTraffic, state: str, found: str) -> None:
    finding = diagnosis.reader(traffic)
    assert finding is not None
    assert (finding.check, finding.state) == ("reader", state)
    assert found in finding.found
    assert bool(finding.cure) == (state != "ok")


@pytest.mark.parametrize("traffic", [replace(TRAFFIC, taken=0, dropped=3), replace(TRAFFIC, lost="gone")])
def test_of_a_port_that_takes_nothing_no_reader_is_told(traffic: PortTraffic) -> None:
    assert diagnosis.reader(traffic) is None


# -- all in all ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("failed", "code"),
    [
        ([], 0),
        (["link"], 3),
        (["port"], 3),
        (["bytes"], 3),
        (["packets"], 3),
        (["packets", "baud"], 3),
        (["heartbeat"], 3),
        (["ATTITUDE", "pose"], 1),
        (["position"], 1),
        (["frames"], 1),
        (["reader"], 1),
        (["pose", "port"], 3),
    ],
)
def test_the_exit_code_and_the_verdict_are_those_of_what_failed(failed: list[str], code: int) -> None:
    findings = [Finding("home", "note", "unknown yet"), *(Finding(check, "fail", "") for check in failed)]
    verdict = diagnosis.verdict(findings, "arva-hil run …")
    assert diagnosis.exit_code(findings) == code
    assert verdict.state == ("fail" if failed else "ok")
    assert "arva-hil run …" in verdict.found + verdict.cure
    assert all(check in verdict.found for check in failed)
