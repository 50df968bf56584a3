"""Records of a log that are given together have the effect of records that are given one after the other."""

from __future__ import annotations

import pytest

from arva_hil.config import parse
from arva_hil.emulator.emulated_vehicle import one_vehicle
from arva_hil.emulator.engine import Emulator
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.vehicle.session import Session

PLAIN = "transmitters: [{id: 7, ned: [20, 5, 0]}]\nreceiver: {rate_hz: 10}"


def records() -> list[tuple[float, bytes]]:
    """Of a vehicle that drives north: with what nobody uses, with another system, broken ones, and two in one."""
    ours, others = Encoder(1, 1), Encoder(9, 1)
    made = []
    for n in range(300):
        now, ms = n * 0.02, 1000 + 20 * n
        place = dialect.MAVLink_global_position_int_message(
            ms, 460_000_000 + 10 * n, 70_000_000, 500_000, 0, 100, 0, 0, 0
        )
        attitude = dialect.MAVLink_attitude_message(ms, 0.01 * n, 0.0, 0.0, 0.5, 0.0, 0.0)
        said = [ours.pack(place), ours.pack(attitude), ours.pack(dialect.MAVLink_vfr_hud_message(0, 1, 0, 0, 2, 3))]
        if n % 50 == 0:
            home = dialect.MAVLink_home_position_message(
                460_000_000, 70_000_000, 500_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            )
            beat = dialect.MAVLink_heartbeat_message(2, 3, 0x81 if n < 200 else 1, 4, 4, 3)
            said += [ours.pack(beat), ours.pack(home), others.pack(beat)]
        if n % 7 == 0:
            said += [others.pack(attitude), said[0][:-1], b"\xfd", said[1] + said[2], said[2][:-2] + b"??"]
        made += [(now, raw) for raw in said]
    return made


@pytest.mark.parametrize(
    "more", ["", "\nspec: 2\npose: truth", "\nspec: 2\nterrain: autopilot"], ids=["plain", "truth", "terrain"]
)
def test_records_given_together_have_the_same_effect(more: str) -> None:
    together, alone = (
        Emulator(
            [one_vehicle(parse(PLAIN + more, "test"), Session(passive=True))],
            start=0.0,
            look_ahead_s=1.0,
            tell_packets=True,
        )
        for _ in range(2)
    )
    every = records()
    for at in range(0, len(every), 40):
        part = every[at : at + 40]
        together.receive_records("autopilot", part)
        for now, raw in part:
            alone.receive("autopilot", raw, now, whole=True)
        for engine in together, alone:
            engine.advance(part[-1][0])
        outputs = [engine.output() for engine in (together, alone)]
        assert [one.data for one in outputs[0]] == [one.data for one in outputs[1]]
        assert list(map(repr, together.events())) == list(map(repr, alone.events()))
    for engine in together, alone:
        assert engine.vehicles[0].session.ignored > 0
    assert together.vehicles[0].session.counts() == alone.vehicles[0].session.counts()
