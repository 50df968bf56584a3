"""The display of a handheld: five lights, two digits."""

from __future__ import annotations

import pytest

from arva_hil.config import parse
from arva_hil.emulator.build import receiver, transmitters
from arva_hil.model.field import LocalFrame
from arva_hil.model.receiver import Look
from firmware_proto import INNER, MID, Channel, Frame
from firmware_proto.handheld import HandheldDecoder, encode_handheld
from tests.every import every
from tests.made_records import HOME, pose_at


@every(
    "channel, line, back",
    [
        (Channel(1, MID, 1905, 22), "...*. 19", (MID, 1900, 36)),
        (Channel(1, MID, 1050, -89), "*.... 11", (MID, 1100, -72)),
        (Channel(1, MID, 994, 89), "....* 9.9", (MID, 990, 72)),
        (Channel(1, MID, 995, 0), "..*.. 10", (MID, 1000, 0)),
        (Channel(1, MID, 20000, 0), "..*.. 99", (MID, 9900, 0)),
        (Channel(1, INNER, 85, 0), "..... 0.9", (INNER, 90, 0)),
        (Channel(), "..... --", (0, -1, -1)),
    ],
)
def test_a_display_and_what_it_tells(channel: Channel, line: str, back: tuple[int, int, int]) -> None:
    data = encode_handheld(Frame(5, 1, (Channel(), channel)))
    assert data == f"{line}\r\n".encode()
    (frame,) = HandheldDecoder().feed(data, 0.0)
    (decoded,) = frame.channels
    assert (decoded.zone, decoded.d, decoded.delta) == back
    assert decoded.id is None


@every("line", ["**... 12", "*.... --", "..... 1", "..... 123", "......12", ".*... 1,2", "19,22"])
def test_other_lines_are_dropped(line: str) -> None:
    decoder = HandheldDecoder()
    assert decoder.feed(f"{line}\n".encode(), 0.0) == []
    assert decoder.dropped == len(line) + 1


def test_the_display_of_the_profile_is_late_and_in_classes() -> None:
    text = "spec: 2\ntransmitters: [{id: 1, ned: [20, 0, 0]}]\nreceiver: {profile: builtin:handheld, lag_s: %g}\n"
    shown = {}
    for lag_s in 0.0, 1.5:
        scenario = parse(text % lag_s, "s.yaml")
        model, there = receiver(scenario), transmitters(scenario, LocalFrame(*HOME))
        t, first = 0.0, 0.0
        while not first and t < 20:
            model.look(Look(t, pose_at(0.0), there))
            first = t if model.show(t).channels[0].zone else 0.0
            t = min(model.next_look(t, t + 0.1), t + 0.1)
        shown[lag_s] = first
        channel = model.show(t).channels[0]
        assert channel.d_cm % 100 == 0
        assert channel.delta_deg in (-72, -36, 0, 36, 72)
    assert shown[1.5] - shown[0.0] == pytest.approx(1.5, abs=0.2)
