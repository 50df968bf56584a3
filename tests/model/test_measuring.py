"""Receivers that hand on what they measure: strength alone, or signed signals with rhythm, carrier and time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arva_hil.model.field.keying import Keying
from arva_hil.model.receiver import Answer, Zone
from tools.figures.sets import Hovering, transmitters

STEADY = Keying(1.0, 0.08, 0.25, carrier_hz=12.0)
SCALE = 2e6 * math.pi  # nA/m of the reference transmitter's field of 1


def test_a_vector_is_the_field_at_three_antennas_with_rhythm_carrier_and_the_end_of_the_pulse() -> None:
    rotation = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
    there = transmitters([12, -5, 3], keyings=[STEADY], strengths=[0.7])
    receiver = Hovering(there, (1.0, 2.0, -3.0), rotation, model="vector")
    (channel,) = receiver.read(5.9).channels[:1]
    expected = SCALE * (there.field_at(np.array([1.0, 2.0, -3.0])) @ rotation)[0]
    assert channel.pulse.signal_na_m == pytest.approx(expected.tolist())
    assert channel.pulse.time_s == pytest.approx(5.33)
    assert channel.pulse.period_s == pytest.approx(1.0)
    assert channel.pulse.carrier_hz == 12.0
    assert channel.pulse.level_dbfs is None
    assert channel.zone == Zone.MID


def test_the_noise_of_a_vector_is_the_same_on_each_antenna() -> None:
    receiver = Hovering(transmitters([5, 5, 0], keyings=[STEADY]), model="vector", noise="gaussian", noise_na_m=2.0)
    pulses = [reading.channels[0].pulse for reading in receiver.readings(1500.0, 1.0)[3:]]
    signals = np.array([pulse.signal_na_m for pulse in pulses if pulse])
    assert len(signals) > 1400
    assert signals.std(axis=0) == pytest.approx([2.0] * 3, rel=0.07)


def test_strength_alone_is_the_projection_on_one_antenna_in_decibels_whoever_sends() -> None:
    receiver = Hovering(transmitters([20, 0, 0], keyings=[STEADY]), model="rssi")
    (channel,) = receiver.read(5.9).channels
    strength = SCALE / (2 * math.pi * 20**3)
    assert channel.pulse.signal_na_m == pytest.approx((strength, 0.0, 0.0))
    assert channel.pulse.level_dbfs == pytest.approx(20 * math.log10(strength / 1e6))
    assert (channel.id, channel.zone, channel.delta_deg) == (None, Zone.MID, 0)
    receiver.rotation = Rotation.from_euler("z", 60, degrees=True).as_matrix()
    turned = receiver.read(6.9).channels[0].pulse
    assert turned.level_dbfs == pytest.approx(channel.pulse.level_dbfs - 20 * math.log10(2))
    receiver.silence(0)
    assert receiver.read(7.7).channels[0].pulse == turned
    assert receiver.read(8.1).channels[0].pulse is None


def test_pulses_at_the_same_time_add_up_in_power() -> None:
    in_step = [STEADY, Keying(1.0, 0.08, 0.27, carrier_hz=60.0)]
    one = Hovering(transmitters([20, 0, 0], keyings=in_step[:1]), model="rssi").read(5.9).channels[0].pulse
    two = Hovering(transmitters([20, 0, 0], [-20, 0, 0], keyings=in_step), model="rssi").read(5.9).channels[0].pulse
    assert two.level_dbfs == pytest.approx((one.level_dbfs or 0) + 10 * math.log10(2))


def test_they_ask_for_a_frame_with_each_pulse_and_strength_alone_can_only_be_restarted() -> None:
    for model, expected in [("vector", 9), ("rssi", 10)]:
        assert sum(map(bool, Hovering(transmitters([20, 0, 0], keyings=[STEADY]), model=model).looks(10.0))) == expected
    receiver = Hovering(transmitters([20, 0, 0], keyings=[STEADY]), model="rssi", start_s=2.0)
    assert receiver.model.command(0.0, "mark", [1]) is Answer.UNKNOWN
    receiver.read(5.9)
    assert receiver.model.command(5.9, "restart", []) is Answer.DONE
    assert receiver.read(7.5).channels[0].zone == Zone.OUTER
    assert receiver.read(8.5).channels[0].zone == Zone.MID
