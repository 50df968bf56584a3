"""A relay between a search and a simulator, which records each message with its time; and a pilot on it."""

from __future__ import annotations

import contextlib
import gc
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.mavlink.dialect import MAVLINK_MSG_ID_CURRENT_MODE

SPACING_M: Final = 30  # TERRAIN_SPACING
PER_DEGREE_M: Final = 111_318.8  # of latitude, ArduPilot's
_LAND: Final = (9, 0), (4, 6)  # modes of ArduCopter and PX4
ORDERS: Final = (
    dialect.MAV_CMD_COMPONENT_ARM_DISARM,
    dialect.MAV_CMD_DO_SET_MODE,
    dialect.MAV_CMD_NAV_TAKEOFF,
    dialect.MAV_CMD_NAV_LAND,
)


def run_first() -> None:
    """Let all threads of this program run before others, without pauses: neither must look like a late search.

    Raises PermissionError without the right to do so. Programs that it starts get `run_as_others`.
    """
    gc.disable()  # it would visit all notes, which takes 0.2 s after some minutes
    os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def run_as_others() -> None:
    """Undo `run_first` in a started process."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class Note(NamedTuple):
    time_s: float
    up: bool  # from the search
    message: Any


class Slope(NamedTuple):
    """Ground that rises to the north, `rise` m a metre, as ArduPilot's terrain data: whole metres every SPACING_M."""

    rise: float
    lat: float  # of home, and the height there, about
    alt: float

    def data(self, request: Any) -> Iterator[Any]:
        """Return the answer to a TERRAIN_REQUEST: 7 rows to the north, each of 8 squares of 4 × 4 heights."""
        for bit in range(56):
            if request.mask >> bit & 1:
                south = (request.lat / 1e7 - self.lat) * PER_DEGREE_M + bit // 8 * 4 * request.grid_spacing
                heights = [round(self.alt + self.rise * (south + i // 4 * request.grid_spacing)) for i in range(16)]
                place = request.lat, request.lon
                yield dialect.MAVLink_terrain_data_message(*place, request.grid_spacing, bit, heights)


class Relay:
    """The relay between search and simulator. `notes`: the messages, in order. `url`: for the search."""

    url: str

    def __init__(self) -> None:
        self.notes: list[Note] = []
        self.mode = -1
        self.armed = False
        self.height = 0.0
        self.ready = False  # ArduPilot knows its place
        self.slope: Slope | None = None  # the ground, for ArduPilot
        self.surveyed = False  # ArduPilot has all the ground that it requested
        self.lie: Callable[[Any], None] | None = None  # changes a message on its way to the search
        self._up, self._down, self._lied = Parser(), Parser(), Parser()
        self._pilot = Encoder(255, 190)
        self._ended = threading.Event()

    def say(self, message: Any) -> None:
        """Send a message as the pilot's ground station."""
        self._to_vehicle(self._pilot.pack(message))

    def close(self) -> None:
        self._ended.set()

    def _to_vehicle(self, data: bytes) -> None:
        raise NotImplementedError

    def _changed(self, data: bytes) -> bytes:
        """Return the bytes for the search, with the lie."""
        if self.lie is None:
            return data
        chunks = []
        for packet in self._lied.feed(data):
            message = decode(packet)
            if message is None or packet.component != 1:
                chunks.append(packet.raw)
                continue
            self.lie(message)
            encoder = Encoder(packet.system, packet.component)
            encoder._codec.seq = packet.raw[4]
            chunks.append(encoder.pack(message))
        return b"".join(chunks)

    def _note(self, data: bytes, up: bool) -> None:
        now, parser = time.monotonic(), self._up if up else self._down
        for packet in parser.feed(data):
            message = decode(packet)
            if message is None:
                continue
            if not up and packet.component == 1:
                self._learn(message)
            if up or packet.component == 1:
                self.notes.append(Note(now, up, message))

    def _learn(self, message: Any) -> None:
        kind = type(message).id
        if kind == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            self.mode = message.custom_mode
            self.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        elif kind == MAVLINK_MSG_ID_CURRENT_MODE:
            self.mode = message.custom_mode
        elif kind == dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
            self.height = message.relative_alt / 1e3
        elif kind == dialect.MAVLINK_MSG_ID_TERRAIN_REQUEST and self.slope:
            for data in self.slope.data(message):
                self.say(data)
        elif kind == dialect.MAVLINK_MSG_ID_TERRAIN_REPORT:
            self.surveyed = bool(message.spacing) and not message.pending
        elif kind == dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT:
            self.ready = bool(message.flags & dialect.EKF_POS_HORIZ_ABS)


class TcpRelay(Relay):
    """Connects to the simulator at once, which waits for that; the search may come later."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp:127.0.0.1:{self._server.getsockname()[1]}"
        self._port = port
        self._vehicle: socket.socket | None = None
        self._search: socket.socket | None = None
        for run in (self._serve, self._pump):
            threading.Thread(target=run, daemon=True).start()

    def _serve(self) -> None:
        while self._vehicle is None and not self._ended.is_set():
            try:
                self._vehicle = socket.create_connection(("127.0.0.1", self._port))
            except OSError:
                time.sleep(0.2)
        with contextlib.suppress(OSError):
            while self._vehicle and (data := self._vehicle.recv(65536)):
                if self._search:
                    with contextlib.suppress(OSError):  # it has ended
                        self._search.sendall(self._changed(data))
                self._note(data, up=False)

    def _pump(self) -> None:
        with contextlib.suppress(OSError):
            self._search, _ = self._server.accept()
            while data := self._search.recv(65536):
                self._note(data, up=True)
                self._to_vehicle(data)

    def _to_vehicle(self, data: bytes) -> None:
        if self._vehicle:
            with contextlib.suppress(OSError):
                self._vehicle.sendall(data)

    def close(self) -> None:
        super().close()
        for each in (self._server, self._search, self._vehicle):
            if each:
                each.close()


class UdpRelay(Relay):
    def __init__(self, port: int) -> None:
        super().__init__()
        self._outer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._outer.bind(("127.0.0.1", port))
        self._outer.settimeout(0.2)  # so that its thread ends in time, and releases the port
        self._inner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._inner.bind(("127.0.0.1", 0))
        self._inner.settimeout(0.2)
        with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as free:
            free.bind(("127.0.0.1", 0))
            self._search = free.getsockname()
        self.url = f"udpin:127.0.0.1:{self._search[1]}"
        self._vehicle: Any = None
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._serve, self._pump)]
        for thread in self._threads:
            thread.start()

    def _serve(self) -> None:
        while not self._ended.is_set():
            with contextlib.suppress(OSError):
                data, self._vehicle = self._outer.recvfrom(65536)
                with contextlib.suppress(OSError):
                    self._inner.sendto(self._changed(data), self._search)
                self._note(data, up=False)

    def _pump(self) -> None:
        while not self._ended.is_set():
            with contextlib.suppress(OSError):
                data = self._inner.recv(65536)
                self._note(data, up=True)
                self._to_vehicle(data)

    def _to_vehicle(self, data: bytes) -> None:
        if self._vehicle:
            with contextlib.suppress(OSError):
                self._outer.sendto(data, self._vehicle)

    def close(self) -> None:
        super().close()
        for thread in self._threads:
            thread.join()
        self._outer.close()
        self._inner.close()


class Hands:
    """The pilot's hands on the sticks; their message is sent five times a second."""

    def __init__(self, relay: Relay, message: Callable[[], Any]) -> None:
        self._relay, self._message = relay, message
        threading.Thread(target=self._hold, daemon=True).start()

    def _hold(self) -> None:
        while not self._relay._ended.wait(0.2):
            self._relay.say(self._message())


def tells_mode(message: Any) -> int | None:
    heartbeat = type(message).id == dialect.MAVLINK_MSG_ID_HEARTBEAT
    return message.custom_mode if heartbeat or type(message).id == MAVLINK_MSG_ID_CURRENT_MODE else None


def orders(message: Any) -> bool:
    """Return True for a message that moves the vehicle."""
    target = type(message).id == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
    return target or getattr(message, "command", None) in ORDERS


def orders_landing(message: Any) -> bool:
    """Return True for the orders that land it: NAV_LAND, and the modes that land."""
    order = getattr(message, "command", None)
    mode = order == dialect.MAV_CMD_DO_SET_MODE and (int(message.param2), int(message.param3))
    return order == dialect.MAV_CMD_NAV_LAND or mode in _LAND
