"""A vehicle deafens its receiver: with the throttle that it tells, less on a longer pole."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.autopilot.following.on_request import MotorLoad
from arva_hil.autopilot.following.session import Session
from arva_hil.config import ReceiverOptions, Scenario, Transmitter, VehicleNoiseOptions, parse, to_dict
from arva_hil.events import MotorsHeard, MotorsSilent
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.mavlink.dialect import EscStatus
from arva_hil.model.receiver import Look
from arva_hil.model.receiver.listening import Listening
from tests.every import every
from tests.model.test_receiver_models import START, Vehicle, source
from tests.one_receiver import Flown

HOME = (46.0123, 7.7456, 1650.0)
AUTOPILOT = Encoder(1, 1)
HEARTBEAT = dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)


def hud(throttle: int) -> bytes:
    return AUTOPILOT.pack(dialect.MAVLink_vfr_hud_message(0, 0, 0, throttle, 0, 0))


def outputs(*pulses: int, port: int = 0) -> bytes:
    return AUTOPILOT.pack(dialect.MAVLink_servo_output_raw_message(0, port, *pulses, 0, 0, 0, 0))


def battery(amperes: float, id_: int = 0, function: int = 0) -> bytes:
    m = dialect.MAVLink_battery_status_message(id_, function, 0, 0, [0] * 10, round(100 * amperes), 0, 0, -1)
    return AUTOPILOT.pack(m)


def telemetry(*amperes: float) -> bytes:
    currents = [round(100 * one) for one in amperes]
    return AUTOPILOT.pack(dialect.MAVLink_esc_telemetry_1_to_4_message(bytes(4), [0] * 4, currents, *[[0] * 4] * 3))


def esc_status(index: int, *amperes: float) -> bytes:
    return AUTOPILOT.pack(EscStatus(index, 0, [0] * 4, [0.0] * 4, list(amperes)))


def heard(*chunks: bytes, full_a: float | None = None, apart_s: float = 0.0) -> float:
    session = Session()
    load = MotorLoad("vehicle", session, full_a)
    for n, chunk in enumerate((AUTOPILOT.pack(HEARTBEAT), *chunks)):
        load.observe(session.feed(chunk, 1.0 + n * apart_s), 1.0 + n * apart_s)
    return load.load


def test_the_load_is_the_throttle_or_else_the_mean_of_the_motors_outputs() -> None:
    assert heard() == 0.0
    assert heard(hud(55)) == 0.55
    assert heard(outputs(1400, 1500, 1600, 1700)) == pytest.approx(0.55)
    assert heard(hud(30), outputs(1900, 1900, 1900, 1900)) == 0.3
    assert heard(outputs(900, 900, 0, 0)) == 0.0
    assert heard(outputs(1900, 1900, 1900, 1900, port=1)) == 0.0


def test_with_the_current_at_full_throttle_the_load_is_the_current_that_is_drawn() -> None:
    assert heard(battery(28.0), full_a=80.0) == pytest.approx(0.35)
    assert heard(hud(50), battery(28.0), hud(50), full_a=80.0) == pytest.approx(0.35)
    assert heard(hud(50), battery(28.0)) == 0.5
    assert heard(telemetry(6.0, 7.0, 8.0, 9.0), full_a=60.0) == pytest.approx(0.5)
    assert heard(esc_status(0, 5.0, 5.0, 5.0, 5.0), esc_status(4, 2.5, 2.5, 2.5, 2.5), full_a=60.0) == 0.5
    assert heard(battery(20.0), battery(10.0, id_=1), full_a=60.0) == 0.5
    assert heard(battery(300.0), full_a=60.0) == 1.0


def test_the_battery_comes_before_controllers_that_say_the_same_all_the_time() -> None:
    for chunks in itertools.permutations([battery(30.0), telemetry(0.8, 0.8, 0.8, 0.8), hud(90), outputs(*[1900] * 4)]):
        assert heard(*chunks, full_a=60.0) == 0.5


@every(
    "unknown",
    [
        battery(-0.01),
        battery(-1.0),
        battery(5.0, function=4),
        esc_status(0, math.nan, 1, 1, 1),
        esc_status(0, -1, 1, 1, 1),
    ],
)
def test_a_current_that_is_not_known_or_not_of_the_motors_leaves_it_to_the_throttle(unknown: bytes) -> None:
    assert heard(hud(40), unknown, full_a=60.0) == 0.4


def test_what_has_fallen_silent_gives_way_to_what_is_still_told() -> None:
    assert heard(battery(30.0), hud(20), hud(20), full_a=60.0, apart_s=1.0) == 0.5
    assert heard(battery(30.0), hud(20), hud(20), hud(20), hud(20), full_a=60.0, apart_s=1.0) == 0.2
    assert heard(hud(30), *[outputs(1900, 1900, 1900, 1900)] * 4, apart_s=1.0) == 0.9
    assert heard(battery(30.0), b"", b"", b"", b"", b"", full_a=60.0, apart_s=1.0) == 0.5


def test_a_vehicle_that_does_not_tell_its_load_is_said_once_and_so_is_that_it_tells_it() -> None:
    session = Session()
    load = MotorLoad("vehicle", session)
    told: list[tuple[type[object], float]] = []
    chunks = {0: AUTOPILOT.pack(HEARTBEAT), 12: hud(40), 13: hud(60), 30: AUTOPILOT.pack(HEARTBEAT)}
    for n in range(40):
        events = load.observe(session.feed(chunks.get(n, b""), float(n)), float(n))
        told += [(type(one), one.time_s) for one in events if isinstance(one, MotorsSilent | MotorsHeard)]
    assert told == [(MotorsSilent, 10.0), (MotorsHeard, 12.0), (MotorsSilent, 23.0)]
    assert load.load == 0.6


class Hovering(Vehicle):
    """20 m from the transmitter."""

    def state(self, t: float) -> VehicleState:
        return VehicleState(t - START, np.zeros(3), np.zeros(3), (1.0, 0.0, 0.0, 0.0), 0.01)


def spread(pole_m: float, load: float) -> float:
    """Of the field that d stands for, with a motor above the receiver, relative to the field."""
    keys = "model: pulsed, steps: cm, rate_hz: 1, start_s: 0, threshold_na_m: 0.5, noise: {kind: 'off'}"
    noise = f"mount: {{position: [0, 0, {pole_m}]}}, vehicle_noise: {{motors: [[0, 0, 0]], motor_na_m: 8}}"
    of = source(
        parse(f"spec: 2\ntransmitters: [{{id: 1, ned: [0, 20, 0]}}]\nreceiver: {{{keys}, {noise}}}", "test"),
        Hovering(load),
    )
    frames = of.advance(START + 1000.0)
    field = np.array([f.frame.channels[0].d for f in frames if f.frame.channels[0].valid], float) ** -3
    return float(field.std() / field.mean())


def test_noise_rises_with_the_load_and_falls_with_the_cube_of_the_pole() -> None:
    assert spread(0.5, 0.0) == pytest.approx(0.0, abs=1e-9)
    near, half, far = spread(0.5, 1.0), spread(0.5, 0.5), spread(1.0, 1.0)
    assert half / near == pytest.approx(0.5, rel=0.12)
    assert far / near == pytest.approx(1 / 8, rel=0.12)


def test_the_built_in_vehicle_tells_its_throttle_when_it_is_asked() -> None:
    asking = parse(
        "spec: 2\ntransmitters: [{id: 1, ned: [0, 20, 0]}]\nreceiver: {vehicle_noise: {motors: [[0, 0, 0]]}}", "test"
    )
    flown = Flown(asking, session=Session(rate_hz=10))
    flown.run(20.0)
    ids = [packet.msgid for chunk in flown.diary.packets for packet in chunk.packets]
    assert ids.count(dialect.MAVLINK_MSG_ID_VFR_HUD) > 40
    assert flown.emulator.emulator.vehicles[0].world.at(20.0).load == 0.0


def test_without_vehicle_noise_nobody_is_asked_for_the_throttle() -> None:
    quiet = Scenario((Transmitter(1, ned=(0.0, 20.0, 0.0)),), receiver=ReceiverOptions(model="pulsed"))
    assert quiet.receiver.vehicle_noise is None
    with pytest.raises(ValueError, match="motor_na_m"):
        VehicleNoiseOptions(((0.0, 0.0, 0.0),), -1.0)


class Accelerating(Vehicle):
    """From rest, northwards at 1 m/s² for 2 s, then on."""

    def state(self, t: float) -> VehicleState:
        s = t - START
        speed, way = (s, s * s / 2) if s < 2 else (2.0, 2 * s - 2)
        velocity, level = np.array([speed, 0.0, 0.0]), (1.0, 0.0, 0.0, 0.0)
        return VehicleState(s, np.array([way, 0.0, -10.0]), velocity, level, 0.01)


def test_a_receiver_on_a_rope_lags_behind_swings_and_hangs_lower_than_its_vehicle() -> None:
    rope = parse(
        "spec: 2\ntransmitters: [{id: 1, ned: [0, 20, 0]}]\nreceiver: {rate_hz: 10, mount: {sling: {length_m: 6}}}",
        "test",
    )
    assert parse(str(to_dict(rope)).replace("'", '"'), "test") == rope
    made = source(rope, Accelerating()).advance(START + 10.0)
    off = [(f.pose.position - Accelerating().state(START + f.instant_s).position) for f in made if f.pose]
    assert [float(np.linalg.norm(one)) for one in off] == pytest.approx([6.0] * len(off))
    north = [float(one[0]) for one in off]
    assert min(north[:20]) < -0.6
    assert max(north[20:]) > 0.3


def test_a_rope_takes_the_receiver_out_of_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    original = Listening.look
    hanging = "mount: {sling: {length_m: 1.0}}, vehicle_noise: {motors: [[0, 0, 0]], motor_na_m: 8}"
    text = f"spec: 2\ntransmitters: [{{id: 1, ned: [0, 20, 0]}}]\nreceiver: {{model: pulsed, start_s: 0, {hanging}}}"
    looks: list[Look] = []
    monkeypatch.setattr(Listening, "look", lambda self, look: looks.append(look) or original(self, look))
    source(parse(text, "test"), Hovering(motors=1.0)).advance(START + 3.0)
    assert len(looks) > 2
    assert {look.impairment.noise_na_m for look in looks if look.impairment} == {
        1.0
    }  # an eighth of what it is at 0.5 m
