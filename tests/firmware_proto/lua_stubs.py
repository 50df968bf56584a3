"""An autopilot to run the Lua scripts on: ArduPilot's sandbox and scheduler in Lua 5.3, its libraries as stubs.

What ArduPilot refuses, the stubs refuse: names that its sandbox lacks, scripts of more than 100 local variables, texts
and log rows that do not fit, passes of more instructions than SCR_VM_I_COUNT allows by default.
"""

from __future__ import annotations

import math
import os
from collections import deque
from pathlib import Path
from typing import Any

import lupa.lua53 as lupa
import pytest

import firmware_proto
from firmware_proto import Channel, Command, CommandAnswer, Frame, LevelChannel, Measured, VectorChannel
from firmware_proto.commands import NAMES
from firmware_proto.measured import MeasuredMessage

FOLDER = Path(firmware_proto.__file__).parent / "ardupilot"
VM_I_COUNT = 10_000

GUIDED = 4
LOITER = 5

_STICKS = ("ROLL", "PITCH", "THROTTLE", "YAW")
_RANGES = {"B": (0, 255), "b": (-128, 127), "H": (0, 65535), "h": (-32768, 32767), "I": (0, 2**32 - 1)}

# The sandbox of lua_scripts.cpp and lbaselib.c; a pass under the count hook, as run_next_script does it.
_SANDBOX = """
local stubs, folder = ...
local sandbox = {math = math, table = table, string = string, io = io}
for name in ("assert error ipairs load next pairs pcall setmetatable tonumber tostring type"):gmatch("%a+") do
   sandbox[name] = _G[name]
end
sandbox.package = {path = "@ROMFS/scripts/modules/?.lua;" .. folder .. "/modules/?.lua"}

local function compile(path)
   local file = assert(io.open(path, "rb"))
   local text = file:read("a")
   file:close()
   local hundred = {}                  -- ArduPilot's lparser.c takes 100 local variables, this Lua 200
   for k = 1, 100 do
      hundred[k] = "_" .. k
   end
   assert(load("local " .. table.concat(hundred, ",") .. " " .. text, "@" .. path, "t", sandbox))
   return assert(load(text, "@" .. path, "t", sandbox))
end

local loaded = {}
function sandbox.require(name)
   for path in sandbox.package.path:gmatch("[^;]+") do
      path = path:gsub("?", name)
      local file = not loaded[name] and io.open(path)
      if file then
         file:close()
         loaded[name] = compile(path)(name, path)
      end
   end
   return loaded[name] or error("module '" .. name .. "' not found")
end

local function uint32(value)
   return {toint = function() return value end}
end

sandbox.millis = function() return uint32(stubs.time_ms) end
sandbox.Parameter = function()
   local name
   return {
      init = function(_, wanted) name = wanted return stubs.has_param(wanted) end,
      get = function() return stubs.get_param(name) end,
      set_and_save = function(_, value) return stubs.set_param(name, value) end,
   }
end
sandbox.param = {
   add_table = function(_, key, prefix, count) return stubs.add_table(key, prefix, count) end,
   add_param = function(_, key, idx, name, value) return stubs.add_param(key, idx, name, value) end,
}
sandbox.gcs = {send_text = stubs.send_text, send_named_float = stubs.send_named_float}
sandbox.logger = {write = stubs.log}
sandbox.serial = {
   find_serial = function(_, instance)
      if not stubs.has_port(instance) then
         return nil
      end
      return {
         begin = function(_, baud) stubs.begin(instance, baud) end,
         read = stubs.read,
         write = stubs.write,
      }
   end,
   find_simulated_device = function(_, protocol, instance)
      if protocol ~= 28 or not stubs.has_port(instance) then
         return nil
      end
      return {writestring = function(_, text) for k = 1, #text do stubs.write(nil, text:byte(k)) end end}
   end,
}

local function vector(x, y, z)
   local v = {x, y, z}
   local function axis(k)
      return function(_, value)
         v[k] = value or v[k]
         return v[k]
      end
   end
   return {x = axis(1), y = axis(2), z = axis(3)}
end

local function state(name)
   return function() return stubs[name] end
end

local function by_name(calls, ...)
   for _, name in ipairs({...}) do
      calls[name] = stubs[name]
   end
   return calls
end

sandbox.Vector3f = function() return vector(0.0, 0.0, 0.0) end
sandbox.ahrs = {
   get_relative_position_NED_origin = function()
      if stubs.has_position then
         return vector(stubs.position[0], stubs.position[1], stubs.position[2])
      end
      return nil
   end,
   get_relative_position_NED_home = function()
      if stubs.has_position then
         return vector(stubs.position[0], stubs.position[1], stubs.position[2] - stubs.home_down)
      end
      return nil
   end,
   get_origin = function()
      local lat, lng = stubs.origin[0], stubs.origin[1]
      return {
         lat = function() return lat end,
         lng = function() return lng end,
         offset = function(_, north, east)
            lat, lng = lat + math.floor(north * 89.8 + 0.5), lng + math.floor(east * 131.0 + 0.5)
         end,
      }
   end,
   get_relative_position_D_home = function() return stubs.position[2] - stubs.home_down end,
   get_roll_rad = state("roll"),
   get_pitch_rad = state("pitch"),
   get_yaw_rad = state("yaw"),
}
sandbox.vehicle = by_name({
   set_target_velaccel_NED = function(_, velocity, acceleration, ...)
      assert(acceleration:x() == 0 and acceleration:y() == 0 and acceleration:z() == 0)
      return stubs.set_velocity(velocity:x(), velocity:y(), velocity:z(), ...)
   end,
   set_target_pos_NED = function(_, place, ...) return stubs.set_place(place:x(), place:y(), place:z(), ...) end,
   get_mode = state("mode"),
   get_likely_flying = state("flying"),
   is_taking_off = state("taking_off"),
}, "set_mode")
sandbox.arming = {is_armed = state("armed")}
sandbox.battery = {has_failsafed = state("failsafed")}
sandbox.fence = {get_breaches = state("breaches")}
sandbox.rangefinder = by_name({}, "status_orient", "distance_orient")
sandbox.terrain = by_name({}, "height_above_terrain")
sandbox.rc = by_name({
   get_channel = function(_, number)
      local read = function() return stubs.stick(number) end
      return {norm_input_dz = read, norm_input_ignore_trim = read}
   end,
   has_valid_input = state("rc"),
}, "get_aux_cached")

-- Between the steps of the collector lupa may give the index of one Python object to another one: no step by itself.
collectgarbage("stop")
local function collect()
   if collectgarbage("count") > 4000 then
      collectgarbage()
   end
end

local function limited(run, limit)
   collect()
   local over = false
   local function hook()
      over = true
      debug.sethook(hook, "", 1)
      error("Exceeded CPU time")
   end
   debug.sethook(hook, "", limit)
   local success, again, delay = pcall(run)
   debug.sethook()
   if over or not success then
      error(over and "exceeded time limit" or again, 0)
   end
   return again, delay
end

local function count(run)
   local steps = 0
   debug.sethook(function() steps = steps + 1 end, "", 1)
   run()
   debug.sethook()
   return steps
end

-- gives a decoder of messages a chunk, as a driver does
local function feed_messages(decoder, chunk, now)
   collect()
   decoder.tell_time(now)
   for k = 1, #chunk do
      decoder.take(chunk:byte(k), now)
   end
end

-- a port that holds one chunk
local function chunk_port()
   local text, at = "", 0
   return {
      put = function(chunk) collect() text, at = chunk, 0 end,
      read = function() at = at + 1 return text:byte(at) or -1 end,
   }
end

return sandbox, compile, limited, count, chunk_port(), feed_messages
"""


class Autopilot:
    """Remembers what one script was given and what it did. `time_ms`: since boot, moved by `run`.

    `folder`: where the scripts lie. `port`: the index of the scripting port that has the receiver, or None.
    `params`: those set beforehand, also by the user.
    """

    def __init__(self, folder: Path = FOLDER, port: int | None = 0, time_ms: int = 5000, **params: float) -> None:
        self.time_ms = time_ms
        self.params: dict[str, float] = {f"RCMAP_{name}": k for k, name in enumerate(_STICKS, 1)} | params
        self.tables: dict[int, str] = {}
        self.texts: list[tuple[int, str]] = []  # severity, text
        self.floats: list[tuple[str, float]] = []
        self.rows: list[tuple[str, dict[str, int]]] = []  # name, fields
        self.written: list[tuple[int, int]] = []  # ms, byte
        self.read_log: list[tuple[int, int]] = []  # ms, byte
        self.baud: int | None = None
        self.mode = GUIDED
        self.armed = self.flying = True
        self.taking_off = False
        self.position = [0.0, 0.0, -2.0]  # NED from the EKF's origin, m
        self.has_position = True
        self.home_down = 0.0  # from there
        self.origin = (473977420, 85455940)
        self.roll = self.pitch = self.yaw = 0.0
        self.range: float | None = None  # of the rangefinder
        self.terrain: float | None = None  # height above it
        self.failsafed = False
        self.breaches = 0
        self.rc = True
        self.sticks = dict.fromkeys(_STICKS, 0.0)
        self.switches: dict[int, int] = {}
        self.velocity: tuple[float, float, float] | None = None  # the last one ordered
        self.velocity_ms = 0
        self.place: tuple[float, float, float] | None = None
        self.limit = VM_I_COUNT
        self.no_room_for = ""  # a kind of log row
        self._folder = folder
        self._port = port
        self._line: deque[int] = deque()
        self._lua = lupa.LuaRuntime(encoding="latin-1", unpack_returned_tuples=True)
        parts = self._lua.execute(_SANDBOX, self, os.fspath(folder))
        self.env, self._compile, self._limited, self.count, self.chunk_port, self.feed_messages = parts
        self.table = self._lua.table_from
        self._next: Any = None
        self._next_ms = 0

    # what a test does

    def require(self, name: str) -> Any:
        """What a file gives to a script that requires it."""
        return self._compile(os.fspath(self._folder / f"{name}.lua"))(name)

    def start(self, name: str) -> Autopilot:
        """Load a script and run it for the first time."""
        self._pass(self._compile(os.fspath(self._folder / f"{name}.lua")))
        return self

    @property
    def running(self) -> bool:
        return self._next is not None

    def receive(self, data: bytes) -> None:
        """Bytes come to the port."""
        self._line.extend(data)

    def give(self, data: bytes, ms: int) -> None:
        """Bytes come to the port, and so much time passes."""
        self.receive(data)
        self.run(self.time_ms + ms)

    def run(self, until_ms: int) -> None:
        """Pass after pass as the script asked for them, up to a time."""
        while self._next is not None and self._next_ms <= until_ms:
            self.time_ms = max(self._next_ms, self.time_ms)
            self._pass(self._next)
        self.time_ms = until_ms

    def said(self) -> list[str]:
        """The texts since the last call."""
        texts = [text for _, text in self.texts]
        self.texts.clear()
        return texts

    def _pass(self, function: Any) -> None:
        answer = self._limited(function, self.limit)
        self._next, delay = answer if isinstance(answer, tuple) else (None, None)
        if self._next is not None:
            self._next_ms = self.time_ms + delay

    # what a script does

    def has_param(self, name: str) -> bool:
        return name in self.params

    def get_param(self, name: str) -> float:
        return float(self.params[name])

    def set_param(self, name: str, value: float) -> bool:
        self.params[name] = float(value)
        return True

    def add_table(self, key: int, prefix: str, count: int) -> bool:
        assert 0 <= key <= 200
        assert 0 < count < 64
        assert self.tables.setdefault(key, prefix) == prefix
        return True

    def add_param(self, key: int, index: int, name: str, value: float) -> bool:
        assert 0 < index < 64
        assert len(self.tables[key] + name) <= 16
        self.params.setdefault(self.tables[key] + name, float(value))
        return True

    def send_text(self, _: Any, severity: int, text: str) -> None:
        assert 0 <= severity <= 7
        assert len(text) <= 50, f"{text!r} would come in pieces"
        self.texts.append((severity, text))

    def send_named_float(self, _: Any, name: str, value: float) -> None:
        assert len(name) <= 10
        assert math.isfinite(value)
        self.floats.append((name, value))

    def log(self, _: Any, name: str, labels: str, form: str, *values: Any) -> None:
        if name == self.no_room_for:
            raise MemoryError("no room")
        assert len(name) <= 4
        assert len(labels) < 58
        assert len(form) < 15
        names = labels.split(",")
        assert len(names) == len(form)
        if len(values) > len(form):
            units, multipliers, *values = values
            assert len(units) == len(multipliers) == len(form)
        assert len(values) == len(form)
        for kind, value in zip(form, values, strict=True):
            if kind == "f":
                assert math.isfinite(value)
            else:
                low, high = _RANGES[kind]
                assert isinstance(value, int)
                assert low <= value <= high
        self.rows.append((name, dict(zip(names, values, strict=True))))

    def has_port(self, instance: int) -> bool:
        return instance == self._port

    def begin(self, _: int, baud: int) -> None:
        assert isinstance(baud, int)
        self.baud = baud

    def read(self, _: Any) -> int:
        if not self._line:
            return -1
        byte = self._line.popleft()
        self.read_log.append((self.time_ms, byte))
        return byte

    def write(self, _: Any, byte: int) -> int:
        self.written.append((self.time_ms, byte))
        return 1

    def set_velocity(
        self, n: float, e: float, d: float, use_yaw: bool, yaw: float, use_rate: bool, rate: float, relative: bool
    ) -> bool:
        assert all(map(math.isfinite, (n, e, d)))
        assert (use_yaw, use_rate, rate, relative) == (True, False, 0, False)
        assert yaw == pytest.approx(math.degrees(self.yaw))
        assert self.mode == GUIDED, "an order in the pilot's mode"
        self.velocity, self.velocity_ms, self.place = (n, e, d), self.time_ms, None
        return True

    def set_place(self, *ned_and_yaw: Any) -> bool:
        *ned, use_yaw, _, use_rate, rate, relative, terrain = ned_and_yaw
        assert (use_yaw, use_rate, rate, relative, terrain) == (True, False, 0, False, False)
        self.place = tuple(ned)
        return self.mode == GUIDED

    def set_mode(self, _: Any, mode: int) -> bool:
        self.mode = mode
        return True

    def status_orient(self, _: Any, orientation: int) -> int:
        assert orientation == 25
        return 4 if self.range is not None else 1

    def distance_orient(self, _: Any, orientation: int) -> float:
        assert orientation == 25
        assert self.range is not None
        return self.range

    def height_above_terrain(self, _: Any, extrapolate: bool) -> float | None:
        assert extrapolate is False
        return self.terrain

    def stick(self, number: int) -> float:
        return self.sticks[_STICKS[number - 1]]

    def get_aux_cached(self, _: Any, function: int) -> int | None:
        return self.switches.get(function)


def as_frame(frame: Any) -> Frame:
    """Of the table that the Lua decoder hands on, which it uses again."""
    columns = [getattr(frame, name) for name in ("id", "zone", "d", "delta", "marked")]
    slots = [[column[k] for column in columns] for k in range(1, frame.n + 1)]
    return Frame(
        frame.sequence, frame.status, tuple([Channel(None if id_ == 255 else id_, *rest) for id_, *rest in slots])
    )


class LuaDecoder:
    """A firmware_proto.Decoder that is the Lua one. `feed_ms` may be told how much work a pass may do."""

    def __init__(self, autopilot: Autopilot) -> None:
        frames: list[tuple[int, Frame]] = []  # no reference from Lua to this object: nobody would collect that circle
        self._frames = frames
        self._port = autopilot.chunk_port
        self._decoder = autopilot.require("arva_receiver").Decoder(
            lambda frame: frames.append((frame.time, as_frame(frame)))
        )

    def feed(self, chunk: bytes, now: float, work: float = math.inf) -> list[Frame]:
        return self.feed_ms(chunk, round(1000 * now), work)

    def feed_ms(self, chunk: bytes, now_ms: int, work: float = math.inf) -> list[Frame]:
        return [frame for _, frame in self.feed_timed(chunk, now_ms, work)]

    def feed_timed(self, chunk: bytes, now_ms: int, work: float = math.inf) -> list[tuple[int, Frame]]:
        """Each frame with the time when its last byte came."""
        self._frames.clear()
        self._port.put(chunk.decode("latin-1"))
        while not self._decoder.read(self._port, now_ms, work):
            pass
        return list(self._frames)

    @property
    def counters(self) -> dict[str, int]:
        return {name: self._decoder[name] for name in ("good", "bad_crc", "dropped", "lost")}


class LuaMessageDecoder:
    """The Lua decoder of messages of all kinds: the same messages as Python's decoders give.

    `script`: what requiring arva_receiver gave, if it is to be used again.
    """

    def __init__(self, autopilot: Autopilot, script: Any = None) -> None:
        messages: list[Any] = []  # as above
        self._messages = messages
        self._feed = autopilot.feed_messages
        self._table = autopilot.table
        self._script = script or autopilot.require("arva_receiver")
        want = autopilot.table(dict.fromkeys((1, 2, 16, 17), True))
        self._decoder = self._script.MessageDecoder(want, lambda kind, m: messages.append(as_message(kind, m)))

    def feed(self, chunk: bytes, now: float) -> list[Any]:
        return self.feed_ms(chunk, round(1000 * now))

    def feed_ms(self, chunk: bytes, now_ms: int) -> list[Any]:
        self._messages.clear()
        self._feed(self._decoder, chunk.decode("latin-1"), now_ms)
        return list(self._messages)

    def encode(self, command: Command) -> bytes:
        """Empty when it is refused."""
        code = NAMES.index(command.name) + 1 if command.name in NAMES else int(command.name.removeprefix("command-"))
        raw = self._script.encode_command(command.number, code, self._table(list(command.values)))
        return bytes(raw.values()) if raw else b""

    good = property(lambda self: self._decoder.good)
    bad_crc = property(lambda self: self._decoder.bad_crc)
    dropped = property(lambda self: self._decoder.dropped)


def as_message(kind: int, m: Any) -> Any:
    """Of the table that the Lua decoder hands on. Times are 32 bits, which wrap."""
    if kind in (16, 17):
        name, values = (
            NAMES[m.code - 1] if 1 <= m.code <= len(NAMES) else f"command-{m.code}",
            tuple(m["values"].values()),
        )
        return (
            Command(m.number, name, values) if kind == 16 else CommandAnswer(m.number, name, m.result, values, m.text)
        )
    channels: list[Any] = []
    for c in m.channels.values():
        who, age = (None if c.id == 255 else c.id, c.zone, c.marked), None if c.age == 65535 else c.age
        if kind == 2:
            channels.append(LevelChannel(*who, None if c.level == -0x8000 else c.level, age))
        else:
            carrier = None if c.carrier == -0x8000 else c.carrier
            channels.append(VectorChannel(*who, c.x, c.y, c.z, c.period, carrier, age))
    return MeasuredMessage(m.sequence, m.status, Measured(m.time & 0xFFFFFFFF, tuple(channels)))
