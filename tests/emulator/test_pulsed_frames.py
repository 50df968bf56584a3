"""Receivers of pulses in the emulator: frames at the pulses' rhythm, the same however time is cut, one air for all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arva_hil.autopilot.following.session import Session
from arva_hil.config import KeyingOptions, ReceiverOptions, Scenario, Transmitter, parse
from arva_hil.emulator.build import moving_transmitters, transmitters
from arva_hil.emulator.setup import vehicle_setups
from arva_hil.events import FrameMade
from arva_hil.model.field import LocalFrame
from tests.model.test_receiver_models import PLACE, START, frames, ranges, source


def near(model: str = "pulsed", **options: object) -> Scenario:
    """Two transmitters that a vehicle passes which flies north."""
    return Scenario(
        (
            Transmitter(1, ned=(10.0, 3.0, 0.0), keying=KeyingOptions("modern", 1.25, phase_s=0.4)),
            Transmitter(2, ned=(20.0, -4.0, 0.0), keying=KeyingOptions("modern", 0.9, phase_s=0.1)),
        ),
        receiver=ReceiverOptions(model=model, options=options),
    )


def said(made: list[FrameMade]) -> list[object]:
    return [(one.number, one.instant_s, one.frame.channels) for one in made]


def test_a_frame_comes_right_behind_each_pulse_that_a_slot_shows_and_a_second_later_at_the_latest() -> None:
    chosen = near(frames="pulses", start_s=0.0, steps="cm")
    chosen = replace(chosen, transmitters=chosen.transmitters[:1])  # nobody who overlaps
    made = frames(source(chosen), START + 15.0)
    keyings = transmitters(chosen, LocalFrame(*PLACE)).keyings
    ends = [end for keying in keyings for end in keying.pulses(3.0, 14.9).ends.tolist()]
    instants = [one.instant_s for one in made]
    assert [end for end in ends if not any(abs(end - t) < 1e-6 for t in instants)] == []
    assert max(np.diff(instants)) <= 1.0 + 1e-9
    assert [one.number for one in made] == list(range(len(made)))


def test_at_a_fixed_rate_the_frames_are_where_the_rate_puts_them() -> None:
    assert np.allclose([one.instant_s for one in frames(source(near()), START + 9.5)], range(10))


def test_the_frames_are_the_same_however_time_is_cut() -> None:
    for options in ({"frames": "rate"}, {"frames": "pulses"}):
        step, leap = source(near(**options)), source(near(**options))
        stepped = [one for n in range(1, 201) for one in frames(step, START + n / 10)]
        leaped = frames(leap, START + 20.0)
        assert said(stepped) == said(leaped)
        assert ranges(stepped) == ranges(leaped)


def test_another_seed_is_another_noise_and_another_rhythm_of_what_is_drawn() -> None:
    drawn = "spec: 2\ntransmitters: [{id: 1, ned: [30, 0, 0]}]\nreceiver: {model: pulsed, steps: cm}\nseed: "
    one, same, other = (frames(source(parse(f"{drawn}{seed}", "s")), START + 12.0) for seed in (1, 1, 2))
    assert said(one) == said(same)
    assert said(one) != said(other)


def test_all_receivers_of_a_scenario_hear_the_same_pulses_and_each_its_own_noise() -> None:
    fleet = parse(
        "spec: 2\ntransmitters: [{id: 1, ned: [30, 0, 0]}]\nreceiver: {model: vector}\n"
        "vehicles: [{name: a, receivers: [{name: front, port: pty}, {name: rear, port: pty}]}]",
        "s",
    )
    (setup,) = vehicle_setups(fleet, lambda vehicle: "link", lambda vehicle: Session())
    ends = []
    for receiver in setup.receivers:
        of = source(receiver.scenario)
        of.there = moving_transmitters(setup.scenario, LocalFrame(*PLACE))  # as the engine does
        pulses = [one.reading.channels[0].pulse for one in frames(of, START + 12.0)]
        ends.append([(pulse.time_s, pulse.signal_na_m) for pulse in pulses if pulse])
    (front, rear) = ends
    assert len(front) > 8
    assert [time for time, _ in front] == [time for time, _ in rear]
    assert [signal for _, signal in front] != [signal for _, signal in rear]


def test_255_transmitters_at_once_are_followed() -> None:
    crowd = tuple(Transmitter(n, ned=(float(n % 16), float(n // 16), 1.0)) for n in range(255))
    made = frames(source(Scenario(crowd, receiver=ReceiverOptions(model="pulsed", channels=16))), START + 8.0)
    assert made[-1].reading.overlapping
    assert len(made[-1].reading.channels) == 16
