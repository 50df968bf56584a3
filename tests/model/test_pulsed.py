"""The receiver that listens to pulses: the paper's integers, rhythm, hold and blanks, overlap, slots, marks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arva_hil.model.field import Transmitters
from arva_hil.model.field.keying import Keying
from arva_hil.model.receiver import Answer, Antennas, Impairment, Look, PaperReceiver, Pose, Reading, Zone
from arva_hil.model.receiver.display import Display, PulsedOptions, Shown
from arva_hil.model.receiver.listening import SeparatedPulse
from arva_hil.model.receiver.pulsed import PulseTrack
from tests.every import every
from tools.figures.sets import PAPER, Hovering, transmitters

STEADY = Keying(1.0, 0.08, 0.25)
OTHER = Keying(0.83, 0.08, 0.6, carrier_hz=40.0)
PLACES = st.tuples(*[st.floats(-45, 45)] * 3)


def ids(reading: Reading) -> list[int | None]:
    return [channel.id for channel in reading.channels if channel.id is not None]


def shown(reading: Reading) -> dict[int, int]:
    """d in cm by id, of slots that are not blank."""
    return {c.id: c.d_cm for c in reading.channels if c.id is not None and c.zone}


@given(PLACES, st.integers(0, 2**32 - 1), st.floats(0.5, 2.24), st.sampled_from([1, 3, 4]))
def test_with_pulses_and_noise_off_one_transmitter_hovering_it_settles_to_the_integers_of_the_paper(
    place: tuple[float, float, float], turns: int, strength: float, channels: int
) -> None:
    rng = np.random.default_rng(turns)
    R_t, R_r = Rotation.random(2, rng).as_matrix()
    there = transmitters([0.0, 0.0, 0.0], keyings=[STEADY], strengths=[strength], rotations=[R_t])
    paper = PaperReceiver(Antennas(noise="off"), channels)
    paper.look(Look(0.0, Pose(place, R_r), there))
    expected = [(c.id, c.zone, c.d_cm, c.delta_deg, c.true_range_m) for c in paper.show(0.0).channels]
    reading = Hovering(there, place, R_r, channels=channels, **PAPER).read(2.4)
    assert [(c.id, c.zone, c.d_cm, c.delta_deg, c.true_range_m) for c in reading.channels] == expected
    assert not reading.interference
    assert not reading.more_heard


Step = Callable[[Hovering], None]


def sees(t: float, *wanted: int, **facts: object) -> Step:
    """At `t` the reading has these ids, and of the reading: its `shown`, its `marked` ids, or an attribute."""

    def step(receiver: Hovering) -> None:
        reading = receiver.read(t)
        assert ids(reading) == [*wanted], t
        marked = [c.id for c in reading.channels if c.marked]
        of_all = {"shown": shown(reading), "marked": marked, "slots": len(reading.channels)}
        found = {name: of_all[name] if name in of_all else getattr(reading, name) for name in facts}
        assert found == facts, t

    return step


def asks(t: float, command: str, answer: Answer = Answer.DONE) -> Step:
    """Its host sends a command at `t`."""

    def step(receiver: Hovering) -> None:
        receiver.read(t)
        name, *values = command.split()
        assert receiver.model.command(t, name, [int(value) for value in values]) is answer, (t, command)

    return step


def silent(*indices: int) -> Step:
    """These transmitters are off from now on, all others on."""
    return lambda receiver: receiver.silence(*indices)


def goes(north: float) -> Step:
    return lambda receiver: setattr(receiver, "position", np.array([north, 0.0, 0.0]))


def hears(impairment: Impairment) -> Step:
    return lambda receiver: setattr(receiver, "impairment", impairment)


REFUSED = Answer.REFUSED
BY_TURNS = [Keying(1.0, 0.07, 0.1), Keying(1.0, 0.07, 0.4, carrier_hz=30.0), Keying(1.0, 0.07, 0.7, carrier_hz=-30.0)]
FAR, NEAR = transmitters([20, 0, 0], keyings=[STEADY]), transmitters([4, 0, 0], keyings=[STEADY])
THREE = transmitters([5, 0, 0], [3.5, 0, 0], [30, 0, 0], keyings=BY_TURNS)
TWO = transmitters([5, 0, 0], [20, 0, 0], keyings=BY_TURNS[:2])
ALIKE = transmitters([4, 0, 0], [0, 4, 0], keyings=[STEADY, Keying(1.001, 0.08, 0.6, carrier_hz=5.0)])


@every(
    "story, there, options, steps",
    [
        (  # pulses end at 3.33 and 4.33 s
            "a slot opens with the second pulse behind the start",
            *(FAR, {}, [sees(3.0), sees(4.32), sees(4.34, 1)]),
        ),
        (  # the newest pulse ended at 5.33 s
            "a reading is held for a period and a half, then blank, then the slot is dropped",
            FAR,
            {},
            [
                *(sees(5.4, 1, shown={1: 1800}), silent(0), sees(6.82, 1, shown={1: 1800}), sees(6.84, 1, shown={})),
                *(sees(10.8, 1), sees(10.85), silent(), sees(12.4, 1, shown={1: 1800})),
            ],
        ),
        (
            "the nearest take the slots, and marked ones come behind",
            THREE,
            {"channels": 2},
            [
                *(sees(6.0, 2, 1, more_heard=True), asks(6.0, "mark 2"), sees(6.05, 1, 3, marked=[])),
                *(asks(6.1, "mark 1"), sees(6.15, 3, 2, marked=[2]), asks(6.2, "unmark 2"), sees(6.25, 2, 3)),
            ],
        ),
        (
            "a mark is refused far away and unheard, and no mark is removed where there is none",
            transmitters([8, 0, 0], keyings=[STEADY]),
            {},
            [
                *(asks(0.0, "mark 1", REFUSED), sees(6.0, 1), asks(6.0, "mark 1", REFUSED)),
                *(asks(6.0, "mark 9", REFUSED), asks(6.0, "mark", REFUSED), asks(6.0, "dance", Answer.UNKNOWN)),
                *(asks(6.0, "unmark 1", REFUSED), asks(6.0, "unmark 9", REFUSED)),
            ],
        ),
        (
            "a mark outlives a few missed pulses, and comes back to the same rhythm",
            *(NEAR, {}, [asks(6.0, "mark 1"), silent(0), sees(30.0), silent(), sees(33.0, 1, marked=[1])]),
        ),
        (
            "a mark that is lost goes to whoever has its rhythm, and so the host is led back",
            ALIKE,
            {},
            [
                *(silent(1), asks(6.0, "mark 1"), silent(0, 1), sees(30.0), silent(0), sees(33.0, 2, marked=[2])),
                *(silent(), sees(36.0, 1, 2, marked=[2])),
            ],
        ),
        (
            "a restart forgets marks and rhythms, and takes its time",
            *(NEAR, {}, [asks(6.0, "mark 1"), asks(6.1, "restart"), sees(9.1), sees(12.0, 1, marked=[])]),
        ),
        (
            "hovering for long it goes back to sending until it is told to search",
            FAR,
            {"revert_s": 60.0},
            [
                *(sees(59.0, 1, searching=True), sees(62.0, searching=False), asks(62.0, "search"), sees(65.0, 1)),
                *(goes(3.0), sees(110.0, 1, searching=True)),
            ],
        ),
        (  # then the other one, and the blank slot of the selected one
            "only the selected one is shown while it is heard",
            TWO,
            {},
            [
                *(asks(6.0, "select 2"), sees(6.1, 2), silent(1), sees(9.0, 1, 2)),
                *(asks(9.0, "select 2", REFUSED), asks(9.0, "select")),
            ],
        ),
        (
            "the number of slots is set until the next restart",
            TWO,
            {},
            [
                *(asks(0.0, "channels 1"), asks(0.0, "channels 17", REFUSED), sees(6.0, 1, more_heard=True, slots=1)),
                *(asks(6.0, "restart"), sees(7.0, slots=4)),
            ],
        ),
        (
            "after a restart a late display shows nothing of what it received before",
            FAR,
            {"lag_s": 2.0},
            [sees(7.0, 1), asks(7.0, "restart"), sees(7.01), sees(8.0), sees(13.0), sees(13.5, 1)],
        ),
        (
            "a scan keeps the marks of those that come back",
            NEAR,
            {},
            [
                *(asks(6.0, "mark 1"), asks(6.1, "scan"), sees(6.2), sees(8.0, 1, marked=[1])),
                *(asks(8.0, "unmark"), sees(8.1, 1, marked=[])),
            ],
        ),
        (
            "its self-test fails next to a transmitter or electronics until it is restarted elsewhere",
            NEAR,
            {"self_test_m": 5.0},
            [
                *(sees(6.0, 1, failed=True), goes(-10.0), sees(8.0, 1, failed=True), asks(8.0, "restart")),
                *(sees(12.0, failed=False), hears(Impairment(noise_na_m=1.0)), sees(14.0, 1, failed=False)),
                *(asks(14.0, "restart"), sees(16.0, failed=True)),
            ],
        ),
    ],
)
def test_slots_marks_and_states(story: str, there: Transmitters, options: dict[str, Any], steps: list[Step]) -> None:
    receiver = Hovering(there, **options)
    for step in steps:
        step(receiver)


def test_a_mark_is_refused_while_overlapped() -> None:
    keyings = [Keying(1.0, 0.08, 0.25), Keying(0.9, 0.08, 0.25, carrier_hz=40.0)]
    near = Hovering(transmitters([4, 0, 0], [-4, 0, 0], keyings=keyings))
    answers = []
    for n in range(60, 1000):
        if 1 in shown(near.read(n / 10)):
            answers.append(near.model.command(n / 10, "mark", [1]))
    assert 0.7 < answers.count(Answer.DONE) / len(answers) < 0.95


def test_it_looks_once_a_pulse_and_asks_for_a_frame_then_if_told_so() -> None:
    there = transmitters([20, 0, 0], keyings=[STEADY])
    asked = list(Hovering(there, start_s=0.0, frames="pulses").looks(10.0))
    assert sum(asked) == 9  # ten pulses, the first of which opens nothing
    assert not any(Hovering(there, start_s=0.0).looks(10.0))


def test_a_pulse_out_of_rhythm_does_not_count() -> None:
    receiver = Hovering(transmitters([20, 0, 0], keyings=[STEADY]))
    receiver.read(5.4)
    receiver.transmitters = transmitters([10, 0, 0], keyings=[STEADY])
    assert shown(receiver.read(6.4)) == {1: 920}
    rough = Hovering(transmitters([20, 0, 0], keyings=[Keying(1.0, 0.08, 0.25, jitter_s=0.02)]))
    blanks = sum(not shown(reading) for reading in rough.readings(200.0, 1.0)[5:])
    assert 50 < blanks < 180


def test_a_slot_that_opened_behind_missed_pulses_finds_its_true_rhythm_with_the_next_pulse_and_its_mark_again() -> None:
    quick = Keying(0.7, 0.08, 0.25)  # pulses end at 0.33, 1.03, 1.73, …
    receiver = Hovering(transmitters([4, 0, 0], keyings=[quick]), model="vector")
    assert receiver.read(3.0).channels[0].pulse
    assert receiver.model.command(3.0, "mark", [1]) is Answer.DONE
    receiver.silence(0)
    receiver.read(20.5)
    receiver.silence()
    receiver.read(20.8)  # one pulse at 20.63
    receiver.silence(0)
    receiver.read(21.5)
    receiver.silence()
    (opened, *_), (corrected, *_) = receiver.read(22.1).channels, receiver.read(22.8).channels
    periods = [one.pulse.period_s if one.pulse else None for one in (opened, corrected)]
    assert periods == [pytest.approx(1.4, abs=1e-3), pytest.approx(0.7, abs=1e-3)]
    assert (opened.marked, corrected.marked) == (False, True)


def test_weaker_than_the_threshold_is_not_heard() -> None:
    for threshold, d_m in [(6.168, 54.4), (2.25, 76.2)]:  # on the axis
        for further, expected in [(0.0, [1]), (0.3, [])]:
            receiver = Hovering(transmitters([d_m + further, 0, 0], keyings=[STEADY]), threshold_na_m=threshold)
            assert ids(receiver.read(8.0)) == expected, (threshold, d_m, further)


@every("within_m", [3.0, 60.0, 1000.0])
def test_weaker_than_the_threshold_is_not_heard_by_three_antennas_either(within_m: float) -> None:
    far = transmitters([0.0, 0.0, 88.0], keyings=[STEADY])
    assert ids(Hovering(far, third_within_m=within_m).read(6.0)) == []
    assert ids(Hovering(far, [0.0, 0.0, 30.0], third_within_m=within_m).read(6.0)) == [1]


def test_two_pulses_that_touch_are_lost_or_the_6_db_stronger_one_is_read() -> None:
    """Two transmitters in step, on carriers that can be told apart."""
    in_step = [STEADY, Keying(1.0, 0.08, 0.29, carrier_hz=40.0)]
    assert ids(Hovering(transmitters([20, 0, 0], [-20, 0, 0], keyings=in_step)).read(10.0)) == []
    farther = Hovering(transmitters([20, 0, 0], [40, 0, 0], keyings=in_step)).read(10.0)
    assert shown(farther) == {1: 1800}


def test_while_overlapped_others_vanish_and_it_says_so() -> None:
    receiver = Hovering(
        transmitters([20, 0, 0], [25, 0, 0], keyings=[STEADY, Keying(1.05, 0.08, 0.6, carrier_hz=40.0)])
    )
    readings = receiver.readings(120.0, 0.25)[24:]
    both = [len(shown(reading)) for reading in readings]
    assert set(both) == {0, 2} or set(both) == {0, 1, 2}
    assert any(reading.overlapping for reading in readings)


def test_on_one_carrier_they_merge_into_one_sum_with_a_random_phase() -> None:
    together = [Keying(1.0, 0.08, 0.25), Keying(1.0, 0.08, 0.251, carrier_hz=3.0)]
    receiver = Hovering(transmitters([20, 0, 0], [20, 0.1, 0], keyings=together), **PAPER)
    every = [shown(reading) for reading in receiver.readings(200.0, 1.0)[5:]]
    assert not any(2 in reading for reading in every)
    d = [reading[1] for reading in every if reading]
    assert min(d) == pytest.approx(1834 / 2 ** (1 / 3), rel=0.01)  # in phase: twice the field
    assert max(d) > 2500
    assert len(set(d)) > 100


def test_a_carrier_in_the_pauses_hides_a_weaker_transmitter() -> None:
    """2 m from an old set, another one at 35 m: weaker than what leaks."""
    old = Keying(0.9, 0.2, 0.0, carrier_hz=-40.0, leak_db=-71.0)
    places = [2, 0, 0], [35, 0, 0]
    assert ids(Hovering(transmitters(*places, keyings=[old, STEADY])).read(30.0)) == [1]
    clean = Keying(0.9, 0.2, 0.0, carrier_hz=-40.0)
    assert ids(Hovering(transmitters(*places, keyings=[clean, STEADY])).read(30.0)) == [1, 2]
    switched_on = Keying(0.9, 0.2, 0.0, carrier_hz=-40.0, leak_db=-71.0, from_s=20.0)
    later = Hovering(transmitters(*places, keyings=[switched_on, STEADY]))
    assert [ids(later.read(t)) for t in (19.0, 40.0)] == [[2], [1]]  # before it is switched on nothing leaks


@every("antennas, zone, delta", [(1, Zone.MID, 0), (2, Zone.MID, 45), (3, Zone.INNER, 0)])
def test_one_two_or_three_antennas(antennas: int, zone: int, delta: int) -> None:
    turned = Rotation.from_euler("z", -45, degrees=True).as_matrix()
    receiver = Hovering(transmitters([2, 0, 0], keyings=[STEADY]), rotation=turned, antennas=antennas)
    (channel,) = receiver.read(6.0).channels[:1]
    assert (channel.zone, channel.delta_deg) == (zone, delta)
    assert channel.pulse is None  # no rescuer's set hands on what it measures


def test_a_dead_antenna_leaves_one_direction_and_saturation_a_shortest_distance() -> None:
    there = transmitters([10, 10, 0], keyings=[STEADY])
    assert Hovering(there, gains=(1.0, 0.0, 1.0)).read(6.0).channels[0].delta_deg == 0
    assert Hovering(there, gains=(0.0, 1.0, 1.0)).read(6.0).channels[0].delta_deg == 89
    near = transmitters([0.2, 0, 0], keyings=[STEADY])
    clipped = Hovering(near, saturation_na_m=1e6, **PAPER).read(6.0).channels[0]
    assert clipped.d_cm == pytest.approx(100 * (6283185.3 * 1.542 / (4 * np.pi * 1e6)) ** (1 / 3), abs=1)


@pytest.mark.parametrize("far_off", [0, 30])  # more transmitters are calculated in arrays
def test_the_gains_of_the_antennas_of_a_fault_and_of_the_carrier_are_multiplied(far_off: int) -> None:
    places, keyings = [[2.0, 1.0, 1.5], *[[9000.0, 0.0, 0.0]] * far_off], [STEADY] * (1 + far_off)

    def signal(impairment: Impairment | None, **options: object) -> list[float]:
        receiver = Hovering(transmitters(*places, keyings=keyings), model="vector", **options)
        receiver.impairment = impairment
        return list(receiver.read(4.0).channels[0].pulse.signal_na_m)

    weak = signal(Impairment(gains=(0.9, 0.7, 0.3)), gains=(0.8, 0.6, 0.4), carrier_db=((0.0, -20.0),))
    assert weak == pytest.approx(np.array(signal(None)) * (0.072, 0.042, 0.012))


def test_distances_come_in_the_steps_of_two_digits() -> None:
    for at, expected in [(20.0, 1800), (12.0, 1100), (10.0, 920), (5.0, 460), (1.0, 90), (0.0101, 0)]:
        assert Hovering(transmitters([at, 0, 0], keyings=[STEADY])).read(6.0).channels[0].d_cm == expected
    assert Hovering(transmitters([0.1, 0, 0], keyings=[STEADY]), lowest_m=0.3).read(6.0).channels[0].d_cm == 30


def test_a_receiver_however_sensitive_says_no_distance_that_a_frame_cannot_carry() -> None:
    for at, most, expected in [(300.0, "cm", 27509), (500.0, "cm", 32767), (500.0, "digits", 9900)]:
        far = Hovering(transmitters([at, 0, 0], keyings=[STEADY]), threshold_na_m=1e-4, steps=most)
        assert far.read(6.0).channels[0].d_cm == expected


def test_arrows_are_as_many_as_the_display_has() -> None:
    seen = set()
    for heading in range(0, 360, 3):
        turned = Rotation.from_euler("z", heading, degrees=True).as_matrix()
        receiver = Hovering(transmitters([20, 0, 0], keyings=[STEADY]), rotation=turned, directions=5)
        seen.add(receiver.read(6.0).channels[0].delta_deg)
    assert seen == {-72, -36, 0, 36, 72}


def test_near_by_the_direction_is_zero_or_the_last_one() -> None:
    turned = Rotation.from_euler("z", -45, degrees=True).as_matrix()
    for choice, expected in [("zero", 0), ("frozen", 45)]:
        receiver = Hovering(transmitters([10, 0, 0], keyings=[STEADY]), rotation=turned, near_direction=choice, **PAPER)
        assert receiver.read(6.0).channels[0].delta_deg == 45
        receiver.position = np.array([8.0, 0.0, 0.0])
        channel = receiver.read(8.0).channels[0]
        assert (channel.zone, channel.delta_deg) == (Zone.INNER, expected)


def test_each_transmitter_has_its_own_last_direction_near_by() -> None:
    display = Display(PulsedOptions(near_direction="frozen"), 1.0)
    for index, (y, delta) in enumerate([(1e-4, 45), (-1e-4, -45)]):
        far = display.shown(index, (1e-4, y, 0.0))
        assert (far.zone, far.delta_deg) == (Zone.MID, delta)
    for index, delta in enumerate([45, -45, 0]):  # the third was never far
        close = display.shown(index, (1.0, 0.0, 0.0))
        assert (close.zone, close.delta_deg) == (Zone.INNER, delta)


def test_without_a_pose_pulses_are_missed() -> None:
    receiver = Hovering(transmitters([20, 0, 0], keyings=[STEADY]), start_s=0.0)
    receiver.read(3.0)
    t = receiver.model.next_look(receiver.now, 4.0)
    while t < 8.0:
        receiver.model.look(Look(t, None, receiver.transmitters))
        t = receiver.model.next_look(t, 9.0)
    assert shown(receiver.model.show(8.0)) == {}


def test_a_pulse_on_another_carrier_is_not_in_the_rhythm_of_a_track() -> None:
    track, shown = PulseTrack([]), Shown(Zone.MID, 1000, 0, (0.0, 0.0, 0.0))
    pulses = [SeparatedPulse(float(n), 40.0 * (n == 2), (0.0, 0.0, 0.0), False) for n in range(4)]
    assert [track.hear(one, one.start_s + 0.08, shown) for one in pulses] == [False, True, False, True]


def test_a_carrier_beside_weakens_a_signal_and_leaves_its_direction() -> None:
    weakened = {**PAPER, "carrier_db": ((0.0, 0.0), (40.0, -6.0))}
    keyings = STEADY, replace(STEADY, carrier_hz=40.0)
    on, beside = (
        Hovering(transmitters([10, 10, 0], keyings=[one]), **weakened).read(6.0).channels[0] for one in keyings
    )
    assert beside.d_cm == pytest.approx(on.d_cm * 2 ** (1 / 3), rel=0.01)
    assert beside.delta_deg == on.delta_deg != 0


def test_noise_is_interference_above_the_noise_of_the_receiver() -> None:
    """The paper's noise is 0.651 nA/m."""
    receiver = Hovering(transmitters([10, 10, 0], keyings=[STEADY]), **PAPER)
    for second, (noise_na_m, interferes) in enumerate(((0.6, False), (0.7, True)), 3):
        receiver.impairment = Impairment(noise_na_m=noise_na_m)
        assert receiver.read(float(second)).interference is interferes


def test_antennas_that_fail_saturate_or_hear_electronics_change_what_it_shows_while_they_do() -> None:
    receiver = Hovering(transmitters([10, 10, 0], keyings=[STEADY]), **PAPER)
    sound = receiver.read(6.0).channels[0]
    receiver.impairment = Impairment(gains=(1.0, 0.0, 1.0))
    assert receiver.read(7.0).channels[0].delta_deg == 0
    receiver.impairment = Impairment(saturation_na_m=100.0).also(Impairment(saturation_na_m=1000.0))
    assert receiver.read(8.0).channels[0].d_cm > sound.d_cm
    receiver.impairment = Impairment(noise_na_m=3.0).also(Impairment(noise_na_m=4.0))
    assert len({receiver.read(9.0 + n).channels[0].d_cm for n in range(20)}) > 5
    assert receiver.read(30.0).interference
    receiver.impairment = None
    assert receiver.read(32.0).channels[0].d_cm == sound.d_cm


@every(
    "options, words",
    [
        ({"gains": (0, 0, 0)}, "expected three values in"),
        ({"saturation_na_m": 2.0}, "saturation_na_m 2: expected above threshold_na_m"),
        ({"threshold_na_m": 0.0}, "threshold_na_m: 0.0, expected greater than 0"),
        ({"antennas": 4}, "antennas: 4, expected 1, 2 or 3"),
    ],
)
def test_options_that_no_receiver_has_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Hovering(transmitters([1, 0, 0], keyings=[STEADY]), **options)
