"""Commands of the host: obeyed, answered between the frames, bounded; the frames are what they were."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from arva_hil import __version__
from arva_hil.cli.summary import counters
from arva_hil.config import parse
from arva_hil.emulator.ports import CommandCounters, HostCommands
from arva_hil.events import CommandAnswered, CommandReceived
from arva_hil.model.receiver import Answer
from arva_hil.registry import FORMATS
from firmware_proto import Command, CommandAnswer, Frame, HostForm
from tests.every import every
from tests.one_receiver import Flown

Answered = str | tuple[str, Sequence[int], str]  # the result, or with values and text
TWO = """
receiver: {noise: {kind: off}, rate_hz: %g}
output: {format: %s}
transmitters: [{id: 7, ned: [20, 5, 0]}, {id: 9, ned: [10, 0, 0]}, {id: 11, ned: [900, 0, 0]}]
"""


class Bench(Flown):
    """A vehicle, an emulator and its host."""

    def __init__(
        self, format: str = "binary", rate_hz: float = 10, capacity: int | None = None, model: str = "paper"
    ) -> None:
        text = TWO % (rate_hz, format)
        if model != "paper":
            text = "spec: 2" + text.replace("noise: {kind: off}", f"model: {model}")
        super().__init__(parse(text, "test"), capacity=capacity)
        self.live, self.host = self.emulator, self.consumer
        self.form: HostForm = FORMATS[format].host
        self.answers_of = self.form.answers()
        self.frames_of = FORMATS[format].decoder()
        self.number = 0
        self.raw = b""
        self.go_on(8.0)
        self.take()

    def take(self) -> tuple[list[CommandAnswer], list[Frame]]:
        self.raw, now = self.host.read(), self.clock.now()
        return self.answers_of.feed(self.raw, now), self.frames_of.feed(self.raw, now)

    def ask(self, name: str, *values: int) -> tuple[str, Sequence[int], str]:
        """The answer, and what frames say from then on is in `shown`."""
        self.number += 1
        self.host.write(self.form.command(Command(self.number, name, values)))
        self.go_on(0.5)
        (answer,), frames = self.take()
        assert (answer.number, answer.name) == (self.number, name)
        self.shown = [c.id for c in frames[-1].channels if c.valid]
        self.frames = frames
        return answer.result, answer.values, answer.text

    def obeys(self, asked: Sequence[tuple[str, Answered, list[int] | None]]) -> None:
        """Ask, and compare the answers, and what frames show after them."""
        for command, wanted, shown in asked:
            name, *values = command.split()
            answer = self.ask(name, *map(int, values))
            assert wanted in (answer, answer[0]), command
            assert shown in (None, self.shown), command

    @property
    def counts(self) -> CommandCounters:
        return self.live.emulator.vehicles[0].units[0].port.commands.counters


OBEYED: list[tuple[str, Answered, list[int] | None]] = [  # a command, its answer, the transmitters in frames after it
    ("mark 9", "done", [7]),
    ("mark 200", "refused", None),
    ("mark 11", "refused", None),  # it is there, and too far away
    ("mark", "refused", None),
    ("unmark 7", "refused", None),
    ("unmark 9", "done", [9, 7]),
    ("select 7", "done", [7]),
    ("mark 7", "done", [9]),
    ("select 7", "refused", None),
    ("unmark", "done", None),
    ("channels", ("done", (4,), ""), None),
    ("channels 1", ("done", (1,), ""), None),
    ("channels 0", "refused", None),
    ("channels 17", "refused", None),
    ("channels 2 2", "refused", None),
    ("scan", "unknown", None),
]


@pytest.mark.parametrize("format", ["binary", "nmea"])
def test_the_papers_receiver_obeys_its_host(format: str) -> None:
    bench = Bench(format)
    assert bench.ask("identify") == ("done", (4,), f"paper {__version__} {format}")
    assert bench.shown == [9, 7]
    bench.obeys(OBEYED)
    assert [len(frame.channels) for frame in bench.frames[-2:]] == [1, 1]
    assert bench.frames[-1].status & 4  # more are heard
    assert bench.ask("identify")[1] == (1,)
    bench.obeys([("mark 9", "done", None), ("restart", "done", [9, 7])])
    assert len(bench.frames[-1].channels) == 4
    assert bench.counts.commands == bench.number
    assert bench.counts.bytes_dropped == 0


@every(
    "format, model, identity, asked",
    [
        ("binary", "paper", "paper ", [("command-99 1 2", ("unknown", (), "")), ("restart 1", ("refused", (), ""))]),
        ("text", "paper", f"paper {__version__} text", [("mark 9", "done")]),
        (
            "binary",
            "pulsed",
            "pulsed ",
            [
                *(("scan", "done"), ("search", "done"), ("mark 200", "refused")),
                *(("channels 2", ("done", (2,), "")), ("channels", ("done", (2,), ""))),
            ],
        ),
        (  # one channel, whatever the scenario says
            "binary",
            "rssi",
            "rssi ",
            [("channels", ("done", (1,), "")), ("mark 7", "unknown"), ("restart 1", "refused"), ("restart", "done")],
        ),
    ],
)
def test_formats_and_models_obey_what_they_know(
    format: str, model: str, identity: str, asked: list[tuple[str, Answered]]
) -> None:
    bench = Bench(format, model=model)
    assert bench.ask("identify")[2].startswith(identity)
    bench.obeys([(command, answer, None) for command, answer in asked])


def test_a_restart_begins_the_count_of_frames_anew_and_none_is_lost() -> None:
    bench = Bench()
    bench.ask("restart")
    numbers = [frame.sequence for frame in bench.frames]
    assert 0 in numbers
    assert numbers[numbers.index(0) :] == list(range(len(numbers) - numbers.index(0)))
    assert bench.frames_of.lost == 0


def test_an_answer_comes_whole_between_two_frames() -> None:
    bench = Bench(rate_hz=50)
    for _ in range(20):
        bench.ask("identify")
    assert (bench.frames_of.bad_crc, bench.frames_of.lost) == (0, 0)
    answer = bench.form.answer(CommandAnswer(1, "identify", "done", (4,), f"paper {__version__} binary"))
    assert bench.frames_of.dropped == 20 * len(answer)


def test_without_commands_the_bytes_are_what_they_are_with_refused_ones() -> None:
    """A command that changes nothing changes no byte of a frame."""
    quiet, asked = Bench(), Bench()
    for bench in (quiet, asked):
        if bench is asked:
            bench.host.write(bench.form.command(Command(1, "mark", (200,))) + b"\xa4\x57\x02 no command")
        bench.go_on(3.0)
        bench.take()
    answer = asked.form.answer(CommandAnswer(1, "mark", "refused"))
    assert asked.raw.count(answer) == 1
    assert asked.raw.replace(answer, b"") == quiet.raw


def test_events_and_the_summary_tell_of_commands() -> None:
    bench = Bench()
    bench.ask("mark", 9)
    bench.ask("scan")
    received = [event for event in bench.diary.events if isinstance(event, CommandReceived)]
    answered = [event for event in bench.diary.events if isinstance(event, CommandAnswered)]
    assert [(e.receiver, e.number, e.name, e.values) for e in received] == [
        ("receiver", 1, "mark", (9,)),
        ("receiver", 2, "scan", ()),
    ]
    assert [(e.number, e.result, e.sent) for e in answered] == [(1, "done", True), (2, "unknown", True)]
    counts = counters(bench.live.emulator)["commands"]
    assert (counts["commands"], counts["done"], counts["unknown"]) == (2, 1, 1)
    assert bench.diary.said("command 1 of the host: mark 9") == 1


def test_a_thousand_commands_a_second_are_bounded_and_no_frame_is_late_or_missing() -> None:
    bench = Bench(rate_hz=50)
    before = bench.live.counters.frames
    answers: list[CommandAnswer] = []
    frames: list[Frame] = []
    for k in range(310):
        sent = range(10 if k < 300 else 0)
        bench.host.write(b"".join(bench.form.command(Command((10 * k + n) % 256, "mark", (9,))) for n in sent))
        bench.go_on(0.01)
        some, more = bench.take()
        answers += some
        frames += more
    c = bench.counts
    assert c.commands == 3000
    assert c.done + c.refused + c.unknown + c.busy + c.unanswered == 3000
    assert 60 <= c.done <= 3 * 20 + 10
    assert 60 <= c.busy <= 3 * 20 + 10
    assert len(answers) == c.done + c.busy
    assert {answer.result for answer in answers} == {"done", "busy"}
    assert len(frames) == bench.live.counters.frames - before >= 150
    assert bench.live.counters.latest_s < 1e-9
    assert (bench.frames_of.lost, bench.frames_of.bad_crc) == (0, 0)
    assert sum(isinstance(event, CommandReceived) for event in bench.diary.events) == c.done


def test_a_flood_of_bytes_is_not_looked_at_and_counted() -> None:
    bench = Bench()
    bench.host.write(bytes(100_000))
    bench.go_on(0.5)
    assert bench.counts.bytes_dropped == 100_000
    assert bench.ask("identify")[0] == "done"


def test_half_a_command_is_counted_and_the_next_one_obeyed() -> None:
    bench = Bench()
    raw = bench.form.command(Command(1, "mark", (9,)))
    bench.host.write(raw[:-3])
    bench.go_on(1.0)
    assert (bench.counts.commands, bench.counts.bytes_dropped) == (0, len(raw) - 3)
    bench.host.write(raw[:5])
    bench.go_on(0.05)
    bench.host.write(raw[5:])
    bench.go_on(0.5)
    assert (bench.counts.commands, bench.counts.bytes_dropped) == (1, len(raw) - 3)


def test_an_answer_that_nobody_takes_is_counted_and_no_frame() -> None:
    bench = Bench(capacity=40)  # what a frame has; nobody reads after that
    bench.go_on(1.0)
    dropped = bench.live.counters.dropped
    bench.host.write(bench.form.command(Command(1, "identify")))
    bench.go_on(0.1)
    assert bench.counts.answers_dropped == 1
    (event,) = (event for event in bench.diary.events if isinstance(event, CommandAnswered))
    assert not event.sent
    assert bench.live.counters.dropped <= dropped + 1


def test_commands_are_executed_and_answered_when_no_frame_is_due_soon() -> None:
    asked: list[tuple[Any, ...]] = []

    def obey(*call: Any) -> Answer:
        asked.append(call)
        return Answer.DONE

    scenario, form = parse(TWO % (1, "binary"), "test"), FORMATS["binary"].host
    host = HostCommands("v", "r", scenario, form, obey)
    host.receive(form.command(Command(1, "select", (7,))) + form.command(Command(2, "restart")), 103.0)
    assert asked == []
    assert len(host.advance(103.5)) == 2
    assert asked == [(103.5, "select", (7,)), (103.5, "restart", ())]
    assert host.answers(103.5, next_frame=103.505) == []
    assert len(host.answers(103.51, next_frame=104.5)) == 2
    assert host.answers(103.52, next_frame=104.5) == []


def test_formats_over_mavlink_take_no_commands() -> None:
    flown = Flown(parse(TWO % (1, "tunnel"), "test"), inside=True)
    flown.run(2.0)
    assert "commands" not in counters(flown.emulator.emulator)
