"""Time stamps of signatures outlive the process: what was recorded before is not believed by the next one."""

from __future__ import annotations

import fcntl
import json
import os
import stat
from contextlib import closing
from pathlib import Path

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.mavlink.codec import Encoder, Packet, Parser, dialect
from arva_hil.mavlink.signing import Signing
from arva_hil.runtime.signing_state import PersistentSigning, state_file

KEY = bytes(range(32))
NOW_US = 1_700_000_000_000_000  # since 1970
DAY_US = 86_400_000_000
HEARTBEAT = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = state_file(KEY, {"XDG_STATE_HOME": str(tmp_path)})
    assert path is not None
    return path


class Process:
    """One that has the key, from its start to its end, by a clock of its own."""

    def __init__(self, file: Path | None, now_us: int = NOW_US, link: int = 0) -> None:
        self.said: list[str] = []
        self.signing = PersistentSigning(KEY, now_us, link, file, self.said.append)

    def believes(self, packets: list[Packet]) -> int:
        return sum(not self.signing.judge(packet) for packet in packets)

    def ends(self) -> None:
        self.signing.close()


def of_a_vehicle(count: int, at_us: int = NOW_US, link: int = 0) -> list[Packet]:
    """Packets that it signed at a time."""
    encoder = Encoder(1, 1, signing=Signing(KEY, at_us, link))
    return Parser().feed(b"".join(encoder.pack(HEARTBEAT) for _ in range(count)))


def believed(file: Path, *heard: list[Packet], now_us: int = NOW_US) -> list[int]:
    """How many packets of each list one process believes, from its start to its end; it says nothing."""
    process = Process(file, now_us)
    counts = [process.believes(packets) for packets in heard]
    assert process.signing.refused == {"unsigned": 0, "forged": 0, "replayed": sum(map(len, heard)) - sum(counts)}
    process.ends()
    assert process.said == []
    return counts


@pytest.mark.parametrize("clock_us", [NOW_US + 3_600_000_000, NOW_US, NOW_US - 2 * DAY_US, 0])
@pytest.mark.parametrize("ahead_us", [0, 5 * DAY_US])
def test_packets_that_one_process_heard_are_believed_by_no_later_one_whatever_its_clock_says(
    file: Path, ahead_us: int, clock_us: int
) -> None:
    """The vehicle's clock may be ahead, and a companion computer without a battery may believe that it is 1970."""
    heard = of_a_vehicle(448, NOW_US + ahead_us)
    assert believed(file, heard) == [448]
    assert believed(file, heard, now_us=clock_us) == [0]


def test_what_was_said_long_before_to_others_is_not_believed_either(file: Path) -> None:
    assert believed(file, of_a_vehicle(1)) == [1]
    old, new = (of_a_vehicle(10, NOW_US - ago_us, link=5) for ago_us in (61_000_000, 59_000_000))
    assert believed(file, old, new, now_us=0) == [0, 10]


def test_a_stream_that_was_kept_months_ago_begins_as_a_new_one(file: Path) -> None:
    """Others may have heard and recorded it since."""
    assert believed(file, of_a_vehicle(1)) == [1]
    old, new = (of_a_vehicle(10, NOW_US + days * DAY_US) for days in (100, 200))
    assert believed(file, old, new, now_us=NOW_US + 200 * DAY_US) == [0, 10]


def test_without_a_state_fresh_packets_are_believed_and_old_ones_are_not(file: Path) -> None:
    assert believed(file, of_a_vehicle(10, NOW_US - 61_000_000), of_a_vehicle(10)) == [0, 10]


def test_our_own_time_stamps_go_on_where_they_were_though_the_clock_went_back(file: Path) -> None:
    first = Process(file)
    first.believes(of_a_vehicle(1, NOW_US + 5 * DAY_US))
    last = first.signing.stamp()
    first.ends()
    later = Process(file, NOW_US - DAY_US)
    assert later.signing.stamp() > last
    later.ends()


def test_a_vehicle_that_forgot_its_time_is_believed_once_it_has_heard_us(file: Path) -> None:
    first = Process(file)
    first.believes(of_a_vehicle(100))
    first.ends()
    process = Process(file)
    session = Session(signing=process.signing)
    vehicle = dialect.MAVLink(None, 1, 1)
    vehicle.robust_parsing = True
    vehicle.signing.secret_key, vehicle.signing.sign_outgoing, vehicle.signing.timestamp = KEY, True, 7
    session.feed(bytes(HEARTBEAT.pack(vehicle)), 0.0)
    assert session.vehicle is None
    vehicle.parse_buffer(bytearray(session.poll(0.1)[0]))
    session.feed(bytes(HEARTBEAT.pack(vehicle)), 0.2)
    assert session.vehicle is not None
    process.ends()


# -- the file --------------------------------------------------------------------------------------------------


def test_the_file_is_its_owners_alone_and_does_not_tell_the_key(file: Path) -> None:
    old = os.umask(0)
    try:
        process = Process(file)
        process.believes(of_a_vehicle(3))
        process.ends()
    finally:
        os.umask(old)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    for path in file.parent.iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert not any(part in path.name.encode() + path.read_bytes() for part in (KEY, KEY[:8], KEY.hex().encode()))
    assert state_file(bytes(32), {"XDG_STATE_HOME": str(file.parents[1])}) != file


@pytest.mark.parametrize("environment", [{}, {"XDG_STATE_HOME": ""}, {"XDG_STATE_HOME": "not/absolute"}])
def test_it_lies_in_the_home_folder_unless_told_otherwise(
    environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/home/somebody")
    path = state_file(KEY, environment)
    assert path.parent == Path("/home/somebody/.local/state/arva-hil")


def test_a_killed_process_forgets_five_seconds_at_most(file: Path) -> None:
    process = Process(file)
    before, after = of_a_vehicle(5), of_a_vehicle(5, NOW_US + 5_000_000)
    process.signing.advance(0.0)
    process.believes(before)
    process.signing.advance(5.0)
    process.believes(after)
    process.signing._background.close()  # what was begun is finished, and nothing more is done
    assert believed(file, [*before, *after]) == [5]


def test_several_processes_keep_theirs_together(file: Path) -> None:
    packets = {link: of_a_vehicle(20, NOW_US + link * 1000, link) for link in range(3)}
    processes = [Process(file, link=link) for link in packets]
    for process, own in zip(processes, packets.values(), strict=True):
        assert process.believes(own) == 20
    for process in reversed(processes):
        process.ends()
    assert believed(file, *packets.values()) == [0, 0, 0]


def test_processes_that_run_do_not_take_each_others_time_stamps(file: Path) -> None:
    """The same packets may reach the second one later, by another way."""
    packets = of_a_vehicle(20)
    first, second = Process(file), Process(file)
    assert first.believes(packets) == 20
    first.ends()
    second.signing.advance(30.0)
    assert second.believes(packets) == 20
    second.ends()


def test_nobody_waits_for_a_process_that_holds_the_file_unless_it_ends(file: Path) -> None:
    first = Process(file)
    with file.with_suffix(".lock").open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        second = Process(file)
        second.signing.advance(0.0)
        second.signing.advance(10.0)
        assert second.believes(of_a_vehicle(3)) == 3
    first.ends()
    second.ends()
    assert (first.said, second.said) == ([], [])
    assert believed(file, of_a_vehicle(3)) == [0]


# -- where it cannot be ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 99, b"[]", b'{"newest": -1, "streams": []}', b'{"newest": 1}', b"[" * 100_000, b" " * 2**21],
    ids=["empty", "zeros", "a list", "negative", "no streams", "deep", "large"],
)
def test_a_file_that_is_something_else_is_said_once_and_replaced(file: Path, content: bytes) -> None:
    file.parent.mkdir()
    file.write_bytes(content)
    process = Process(file)
    assert process.believes(of_a_vehicle(3)) == 3
    process.ends()
    (said,) = process.said
    assert f"{file}: time stamps of signatures are not stored (it contains something else)" in said
    assert json.loads(file.read_bytes())["newest"] > 0


def test_a_place_that_cannot_be_is_said_once_and_nothing_else_changes(tmp_path: Path) -> None:
    (tmp_path / "home").touch()
    process = Process(state_file(KEY, {"XDG_STATE_HOME": str(tmp_path / "home")}))
    assert process.believes(of_a_vehicle(3)) == 3
    process.signing.advance(0.0)
    process.signing.advance(10.0)
    process.ends()
    (said,) = process.said
    assert "(Not a directory): recorded packets may be accepted later" in said


def test_what_could_not_be_written_at_first_is_written_once_it_can_be(file: Path) -> None:
    file.with_suffix(".lock").mkdir(parents=True)
    process = Process(file)
    process.believes(of_a_vehicle(3))
    (said,) = process.said
    assert "(Is a directory)" in said
    file.with_suffix(".lock").rmdir()
    process.ends()
    assert process.said == [said]
    assert believed(file, of_a_vehicle(3)) == [0]


def test_without_a_home_folder_it_is_said_once() -> None:
    process = Process(None)
    assert process.believes(of_a_vehicle(3)) == 3
    process.ends()
    assert process.said == [
        "time stamps of signatures are not stored (there is no home folder): recorded packets may be accepted later"
    ]


@pytest.mark.parametrize("suffix", [".json", ".lock"])
def test_a_symlink_is_not_followed(tmp_path: Path, file: Path, suffix: str) -> None:
    target = tmp_path / "of somebody"
    target.write_text("mine")
    file.parent.mkdir()
    file.with_suffix(suffix).symlink_to(target)
    process = Process(file)
    with closing(process.signing):
        assert process.believes(of_a_vehicle(3)) == 3
    assert len(process.said) == 1
    assert target.read_text() == "mine"
