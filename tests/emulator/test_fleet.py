"""Several vehicles with several receivers in one engine: each hears, reads and sends as if it were alone."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator, Sequence

import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import Clock, StepClock
from arva_hil.config import Scenario, parse
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import ReceiverSetup, VehicleSetup, scenario_of, sink_name, vehicle_setups
from arva_hil.events import HeartbeatMissing
from arva_hil.links import Link, LinkError, memory
from arva_hil.links.reconnecting import ReconnectingLink
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run
from arva_hil.simulated.vehicle import SimulatedVehicle
from firmware_proto import Decoder
from tests.one_receiver import Diary, turn

HOME = (46.0123, 7.7456, 1650.0)
ELSEWHERE = (46.1, 7.9, 2100.0)
STREAMS = {dialect.MAVLINK_MSG_ID_ATTITUDE: 50.0, dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0}

FLEET = """
spec: 2
transmitters: [{id: 7, ned: [20, 5, 0]}]
faults: [{drop: 0.2}]
vehicles:
  - name: alpha
    system: 1
    receivers:
      - {name: front, port: pty, mount: {position: [0.5, 0, 0]}}
      - {name: rear, port: pty, rate_hz: 5, format: nmea, mount: {position: [-3, 0, 0], attitude: {yaw: 90}}}
  - name: bravo
    system: 2
    receivers:
      - {name: front, port: pty, rate_hz: 10, format: text, mount: {position: [0, 2, 0]}}
      - {name: rear, port: pty, rate_hz: 20, mount: {position: [0, -2, 0]}, seed: 7}
"""


def fleet() -> Scenario:
    return parse(FLEET, "test")


def two_on_one_link(scenario: Scenario, reader: PacketReader | None = None) -> list[VehicleSetup]:
    shared = reader or PacketReader()
    return vehicle_setups(
        scenario, lambda vehicle: "link", lambda vehicle: Session(target_system=vehicle.system, reader=shared)
    )


def spoken(seconds: float) -> Iterator[tuple[float, bytes]]:
    """What two vehicles and a ground station say on one link, cut anywhere: when, and the bytes."""
    vehicles = [
        SimulatedVehicle(HOME, system=1, streams=STREAMS),
        SimulatedVehicle(ELSEWHERE, system=2, streams=STREAMS),
    ]
    station, left = Encoder(255, 190), b""
    for tick in range(round(seconds * 100)):
        now = tick / 100
        data = left + b"".join(vehicle.poll(now) for vehicle in vehicles)
        if tick % 100 == 0:
            data += station.pack(dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
        cut = len(data) * (tick % 4) // 4
        yield now, data[:cut]
        left = data[cut:]


def sent(setups: Sequence[VehicleSetup], said: Sequence[tuple[float, bytes]]) -> tuple[dict[str, bytes], Diary]:
    """What an engine writes to each receiver's port, every output taken; and what happened."""
    emulator, diary = Emulator(setups, start=0.0, tell_packets=True), Diary()
    written = dict[str, bytes]()
    for now, data in said:
        emulator.receive("link", data, now)
        for output in turn(emulator, now, diary):
            if output.link != "link":
                written[output.link] = written.get(output.link, b"") + output.data
    return written, diary


def test_two_vehicles_on_one_link_send_what_four_single_emulators_would() -> None:
    said, scenario = list(spoken(12.0)), fleet()
    together, diary = sent(two_on_one_link(scenario), said)
    alone = dict[str, bytes]()
    for vehicle in scenario.vehicles:
        for receiver in vehicle.receivers:
            own, sink = scenario_of(scenario, receiver), sink_name(vehicle, receiver)
            setup = ReceiverSetup(receiver.name, sink, own)
            single = VehicleSetup(vehicle.name, "link", Session(target_system=vehicle.system), own, [setup])
            alone |= sent([single], said)[0]
    assert sorted(together) == ["alpha/front", "alpha/rear", "bravo/front", "bravo/rear"]
    assert together == alone
    assert len(set(together.values())) == 4
    last = {(made.vehicle, made.receiver): made for made in diary.frames if made.sent}
    assert all(made.reading.channels[0].id == 7 for made in last.values())
    assert [len([m for m in diary.frames if (m.vehicle, m.receiver) == key]) for key in sorted(last)] == [
        12,
        60,
        120,
        240,
    ]


def test_the_packets_of_a_shared_link_are_split_and_counted_once() -> None:
    said, reader = list(spoken(5.0)), PacketReader()
    setups = two_on_one_link(fleet(), reader)
    _, diary = sent(setups, said)
    alone = PacketReader()
    packets = [packet for now, data in said for packet in alone.feed(data, now)]
    assert (reader.bytes, reader.parser.packets) == (alone.bytes, len(packets))
    assert reader.parser.skipped == reader.parser.bad_crc == 0
    assert [packet for event in diary.packets for packet in event.packets] == packets
    station = sum(packet.system == 255 for packet in packets)
    assert [setup.session.ignored for setup in setups] == [station, station]  # the other vehicle is no stranger


def test_the_datum_of_each_vehicle_is_its_own_home() -> None:
    _, diary = sent(two_on_one_link(fleet()), list(spoken(8.0)))
    assert diary.said("datum: 46.0123000, 7.7456000, 1650.00 m AMSL") == 1
    assert diary.said("datum: 46.1000000, 7.9000000, 2100.00 m AMSL") == 1


def test_sessions_of_one_link_that_read_it_twice_are_refused() -> None:
    setups = vehicle_setups(fleet(), lambda _: "link", lambda vehicle: Session(target_system=vehicle.system))
    with pytest.raises(ValueError, match="the same reader"):
        Emulator(setups, start=0.0)


def test_the_vehicles_of_a_silent_link_are_told_to_be_missing_at_the_same_time() -> None:
    emulator = Emulator(two_on_one_link(fleet()), start=0.0, timeout_s=1.0, spread=True)
    missing: list[HeartbeatMissing] = []
    for millisecond in range(2000):
        emulator.advance(millisecond / 1e3)
        missing += [event for event in emulator.events() if isinstance(event, HeartbeatMissing)]
    assert [event.vehicle for event in missing] == ["alpha", "bravo"]
    assert len({event.time_s for event in missing}) == 1


# -- links: one goes, the others stay ----------------------------------------------------------------------------


class Pair:
    """Two vehicles on memory links of their own, each with one receiver; a task: the vehicles' part.

    `away`: the numbers of vehicles whose cable is pulled; a plugged one is opened again as a serial port is.
    """

    def __init__(self, *, lasting: bool) -> None:
        self.clock, self.diary = StepClock(), Diary()
        self.away = set[int]()
        self.links: Sequence[Link] = ()
        self._vehicles = [SimulatedVehicle(HOME, system, streams=STREAMS) for system in (1, 2)]
        self.far: list[Link] = []
        near = [self._plug(number) for number in (0, 1)]
        if lasting:
            openers = [functools.partial(self._open, number) for number in (0, 1)]
            near = [
                ReconnectingLink(link, opener, self.clock, start=lambda job: job())
                for link, opener in zip(near, openers, strict=True)
            ]
        ports = [memory.pair() for _ in (0, 1)]
        self.consumers = [consumer for _, consumer in ports]
        one = parse("transmitters: [{id: 7, ned: [20, 5, 0]}]\nreceiver: {rate_hz: 10}", "test")
        setups = [
            VehicleSetup(name, name, Session(), one, [ReceiverSetup("front", f"{name}/front", one)])
            for name in ("alpha", "bravo")
        ]
        sinks = {setup.receivers[0].sink: port for setup, (port, _) in zip(setups, ports, strict=True)}
        links = {setup.link: link for setup, link in zip(setups, near, strict=True)}
        self.live = Live(Emulator(setups, start=0.0), links, sinks, Audience([self.diary]))

    def service(self, clock: Clock) -> float:
        now = clock.now()
        for number, vehicle in enumerate(self._vehicles):
            if number not in self.away:
                vehicle.feed(self.far[number].read() if self.far[number].ready() else b"", now)
                with contextlib.suppress(LinkError):  # it is not opened again yet
                    self.far[number].write(vehicle.poll(now))
        return now + 0.01

    def run(self, until: float) -> None:
        run([self, self.live], self.clock, until=until)

    def pull(self, number: int) -> None:
        self.away.add(number)
        self.far[number].close()

    def posed(self, name: str) -> bool:
        """Whether that vehicle's newest frame has a pose."""
        return [made.pose is not None for made in self.diary.frames if made.vehicle == name][-1]

    def count(self, name: str) -> int:
        return sum(made.vehicle == name for made in self.diary.frames)

    def _plug(self, number: int) -> Link:
        near, far = memory.pair()
        self.far[number : number + 1] = [far]
        return near

    def _open(self, number: int) -> Link:
        if number in self.away:
            raise LinkError("link", "is not there")
        return self._plug(number)


def test_one_link_is_lost_and_comes_back_while_the_other_vehicle_goes_on() -> None:
    pair = Pair(lasting=True)
    pair.run(5.0)
    assert pair.posed("alpha")
    assert pair.posed("bravo")
    pair.pull(0)
    pair.run(10.0)
    assert not pair.posed("alpha")
    assert all(made.pose is not None for made in pair.diary.frames if made.vehicle == "bravo" and made.instant_s > 5)
    pair.away.clear()
    pair.run(13.0)
    assert pair.posed("alpha")
    assert pair.count("alpha") == pair.count("bravo") == 131  # no frame was late or left out
    assert max(made.late_s for made in pair.diary.frames) < 0.02


def test_a_link_that_is_gone_for_good_ends_nothing_while_another_is_there() -> None:
    pair = Pair(lasting=False)
    pair.run(5.0)
    pair.pull(0)
    pair.run(10.0)
    assert not pair.posed("alpha")
    assert pair.posed("bravo")
    assert pair.diary.said("lost: closed by the far end") == 1
    pair.pull(1)
    with pytest.raises(LinkError, match="closed by the far end"):
        pair.run(12.0)


def test_a_consumer_that_leaves_for_good_takes_no_other_with_it() -> None:
    pair = Pair(lasting=True)
    pair.run(5.0)
    pair.consumers[0].close()
    pair.consumers[1].read()
    pair.run(10.0)
    assert pair.count("alpha") == pair.count("bravo") == 101
    assert len(Decoder().feed(pair.consumers[1].read(), 0.0)) == 50
