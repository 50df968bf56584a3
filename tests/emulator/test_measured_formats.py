"""Receivers that measure pulses, in the formats that carry them: what was measured goes out before its frame."""

from __future__ import annotations

import math

import pytest

from arva_hil.config import parse
from arva_hil.registry import FORMATS
from firmware_proto import Decoder, Frame
from tests.one_receiver import Diary, Flown

SCENARIO = """
spec: 2
receiver: {model: %s, rate_hz: 5}
output: {format: %s}
transmitters: [{id: 7, ned: [12, 5, 0]}, {id: 9, ned: [-20, 3, 0]}]
"""


def frames_of(model: str, format: str) -> tuple[Diary, list[Frame], bytes]:
    flown = Flown(parse(SCENARIO % (model, format), "test"))
    flown.run(15.0)
    data = flown.consumer.read()
    return flown.diary, FORMATS[format].decoder().feed(data, 15.0), data


@pytest.mark.parametrize(("model", "format"), [("vector", "vector"), ("rssi", "rssi"), ("vector", "rssi")])
def test_the_host_gets_exactly_what_was_made_and_a_decoder_of_version_1_the_integers(model: str, format: str) -> None:
    diary, frames, data = frames_of(model, format)
    assert frames == [made.frame for made in diary.frames]
    old = Decoder()
    assert old.feed(data, 0.0) == [frame._replace(measured=None) for frame in frames]
    assert (old.lost, old.bad_crc) == (0, 0)
    assert sum(any(c.age_ms is not None for c in f.measured.channels) for f in frames if f.measured) > 20


def test_a_vector_is_the_pulse_in_its_units() -> None:
    diary, _, _ = frames_of("vector", "vector")
    compared = 0
    for made in diary.frames:
        assert made.frame.measured.time_ms == round(1000 * made.instant_s)
        for channel, c in zip(made.reading.channels, made.frame.measured.channels, strict=True):
            assert c[:3] == (channel.id, channel.zone, channel.marked)
            if (pulse := channel.pulse) is None:
                assert c.age_ms is None
                continue
            peak = max(map(abs, pulse.signal_na_m))
            assert [a / 100 for a in c[3:6]] == pytest.approx(pulse.signal_na_m, abs=0.006 + peak / 30_000)
            assert c.age_ms == pytest.approx(1000 * (made.instant_s - pulse.time_s), abs=1)
            compared += 1
    assert compared > 20


def test_a_level_is_that_of_the_receiver_or_of_1_na_m() -> None:
    for model in ("rssi", "vector"):
        diary, _, _ = frames_of(model, "rssi")
        for made in diary.frames:
            assert made.frame.measured is not None
            for channel, c in zip(made.reading.channels, made.frame.measured.channels, strict=True):
                if pulse := channel.pulse:
                    own = 20 * math.log10(math.hypot(*pulse.signal_na_m))
                    wanted = own if pulse.level_dbfs is None else pulse.level_dbfs
                    assert c[3] == pytest.approx(100 * wanted, abs=0.51)


def test_a_receiver_that_measures_nothing_sends_empty_channels() -> None:
    _, frames, _ = frames_of("paper", "vector")
    assert {c.age_ms for frame in frames if frame.measured for c in frame.measured.channels} == {None}
    assert any(c.valid for frame in frames for c in frame.channels)
