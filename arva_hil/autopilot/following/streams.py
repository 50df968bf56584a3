"""Requests the streams that a pose needs, measures their rates, and requests them again if they are too slow."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from arva_hil.autopilot.following.navigation import Emit
from arva_hil.events.vehicles import StreamAskedOtherwise, StreamRateLowered
from arva_hil.mavlink.codec import RESULTS, command, dialect

_MEASURE_S: Final = 2.0  # the window of a rate
_JUDGE_S: Final = 1.0  # judge a rate after this time
_SILENT_S: Final = 0.3  # judge a rate after this time if nothing came
_BACKLOG_S: Final = 0.1  # messages that come this soon after a silence had been waiting
_LOOK_S: Final = 0.2  # between two checks of a stream that is fast enough, at least
_MOST_SEEN: Final = 4096  # 2 kHz
_ENOUGH: Final = 0.7  # of the rate requested; a slower stream is requested again
_ACK_S: Final = 1.0
_AGAIN_S: Final = (2.0, 4.0, 8.0, 16.0, 30.0)
_PATIENCE: Final = 3  # requests with one command without effect, before the other command is tried
_SLOWEST_HZ: Final = 4.0

_SET_INTERVAL: Final = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
_POSITIONS: Final = (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,)
_ATTITUDES: Final = (dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION)


class StreamRequest(NamedTuple):
    """A request. `command`: "" before the first one; `result`: MAVLink's name of the answer, "" while there is none."""

    command: str = ""
    hz: float = 0.0
    result: str = ""


@dataclass
class Stream:
    """One stream: what was received, and how it was requested."""

    name: str
    ids: tuple[int, ...]  # the message ids that can be used; the first one is requested
    group: int  # the MAV_DATA_STREAM it belongs to
    want_hz: float
    asked: StreamRequest = field(default_factory=StreamRequest)  # the last one that was answered or timed out
    promised: bool = False  # the vehicle accepted a request
    seen: dict[int, deque[float]] = field(default_factory=dict)  # the latest times at which each id came
    tries: int = 0  # requests since it was fast enough
    by_group: bool = False
    anew: bool = False  # request it even if it is fast enough
    next_ask: float = 0.0
    needed: bool = True  # otherwise it is requested only a few times
    refused: bool = False

    def __post_init__(self) -> None:
        self.seen = {msgid: deque(maxlen=_MOST_SEEN) for msgid in self.ids}

    def rate(self, now: float, since: float) -> float:
        """Return the present rate [Hz] of the fastest of its message ids."""
        oldest = now - _MEASURE_S
        for times in self.seen.values():
            while times and times[0] < oldest:
                times.popleft()
        span = _MEASURE_S if now - since > _MEASURE_S else max(now - since, 0.1)
        return max(map(len, self.seen.values())) / span

    def fast_until(self, now: float, since: float) -> float | None:
        """Return the time [s] until which the stream is fast enough without messages, None if it is too slow `now`."""
        rate = self.rate(now, since)
        if rate < _ENOUGH * self.want_hz and now - since >= (_JUDGE_S if rate else _SILENT_S):
            return None
        newest = max(self.seen.values(), key=len)
        enough = math.ceil(_ENOUGH * self.want_hz * _MEASURE_S)
        return newest[-enough] + _MEASURE_S if now - since > _MEASURE_S and enough <= len(newest) else now


class HomeRequests:
    """Remembers the requests for the home position, and when the next one is due."""

    def __init__(self, now: float) -> None:
        self._next_s = now
        self._count = 0

    def poll(self, now: float, system: int, component: int) -> list[Any]:
        """Return the request, if it is due: REQUEST_MESSAGE and the older GET_HOME_POSITION, in turn."""
        if now < self._next_s:
            return []
        self._next_s = now + _AGAIN_S[0]
        self._count += 1
        if not self._count % 2:
            return [command(system, component, dialect.MAV_CMD_GET_HOME_POSITION)]
        return [command(system, component, dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_HOME_POSITION)]


class Streams:
    """Remembers the streams of one vehicle, the requests for them, and the answers.

    A stream is requested with SET_MESSAGE_INTERVAL, one request at a time because its acknowledgement does not name the
    message. A denied rate is halved. If the command is unknown or has no effect, REQUEST_DATA_STREAM is used. Streams
    that are fast enough already are not requested. `rate_hz`: of the pose streams. `emit`: see `Navigation`.
    """

    def __init__(self, rate_hz: float, emit: Emit) -> None:
        self.rate_hz = rate_hz
        self._emit = emit
        self._extras: dict[int, float] = {}
        self.restart(0.0)

    def restart(self, now: float) -> None:
        """Begin with a new vehicle, which has got no request."""
        self.wanted = [
            Stream("GLOBAL_POSITION_INT", _POSITIONS, dialect.MAV_DATA_STREAM_POSITION, self.rate_hz),
            Stream("ATTITUDE", _ATTITUDES, dialect.MAV_DATA_STREAM_EXTRA1, self.rate_hz),
        ]
        self._all = self.wanted[:]
        self._pending: tuple[Stream, float] | None = None
        self._since = now
        self._home = HomeRequests(now)
        self.want(self._extras)

    def want(self, extras: Mapping[int, float]) -> None:
        """Request these optional streams too: message id → Hz."""
        self._extras |= extras
        self._all += [Stream(f"message {msgid}", (msgid,), 0, hz, needed=False) for msgid, hz in extras.items()]
        self.next_check = 0.0  # of the streams
        self._seen = {msgid: times for stream in self._all for msgid, times in stream.seen.items()}
        self.extra_ids = frozenset(stream.ids[0] for stream in self._all if not stream.needed)

    def on_message(self, msgid: int, now: float) -> None:
        """Count a message of a stream."""
        if now >= self._since:
            self._seen[msgid].append(now)

    def rates(self, now: float) -> dict[str, float]:
        """Return measured rates [Hz] by message name."""
        return {stream.name: stream.rate(now, self._since) for stream in self.wanted}

    def renew(self, now: float) -> None:
        """Request all streams again, with the commands that worked: the vehicle may have forgotten them."""
        self._since = now + _BACKLOG_S
        self._pending, self.next_check = None, 0.0
        self._home = HomeRequests(now)
        for stream in self._all:
            for times in stream.seen.values():
                times.clear()
            stream.tries, stream.next_ask, stream.anew, stream.refused = 0, 0.0, True, False

    def poll(self, now: float, system: int, component: int, *, home: bool) -> list[Any]:
        """Return the requests that are due, as messages. `home`: the home position is wanted too."""
        messages = self._home.poll(now, system, component) if home else []
        if self._pending and now - self._pending[1] > _ACK_S:
            stream, _ = self._pending
            stream.asked = StreamRequest("SET_MESSAGE_INTERVAL", stream.want_hz)
            self._pending = None
        if self._pending or now < self.next_check:
            return messages
        for stream in self._all:
            if self._pending:
                return messages  # the other streams once it is answered
            if now < stream.next_ask or stream.refused:
                continue
            fast_until = None if stream.anew else stream.fast_until(now, self._since)
            if fast_until is None:
                messages.append(self._ask(stream, now, system, component))
            else:
                stream.tries, stream.next_ask = 0, max(fast_until, now + _LOOK_S)
        if not self._pending:
            self.next_check = min([stream.next_ask for stream in self._all if not stream.refused])
        return messages

    def acknowledged(self, command: int, result: int, now: float) -> None:
        """Use a COMMAND_ACK of the vehicle for this program."""
        if command != _SET_INTERVAL or not self._pending or result == dialect.MAV_RESULT_IN_PROGRESS:
            return
        stream, _ = self._pending
        self._pending, self.next_check = None, 0.0
        if not stream.needed:
            stream.refused = stream.refused or result != dialect.MAV_RESULT_ACCEPTED
            return
        stream.asked = StreamRequest("SET_MESSAGE_INTERVAL", stream.want_hz, RESULTS.get(result, f"result {result}"))
        stream.promised = stream.promised or result == dialect.MAV_RESULT_ACCEPTED
        if result == dialect.MAV_RESULT_DENIED and stream.want_hz > _SLOWEST_HZ:
            stream.want_hz = max(stream.want_hz / 2, _SLOWEST_HZ)
            stream.tries, stream.next_ask = 0, 0.0
            self._emit(StreamRateLowered, now, stream.name, *stream.asked, stream.want_hz)
        elif result not in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_TEMPORARILY_REJECTED):
            self._change_kind(stream, now)

    def _ask(self, stream: Stream, now: float, system: int, component: int) -> Any:
        if stream.tries and stream.tries % _PATIENCE == 0 and stream.needed:
            self._change_kind(stream, now)
        stream.next_ask = now + _AGAIN_S[min(stream.tries, len(_AGAIN_S) - 1)]
        stream.tries += 1
        stream.anew = False
        stream.refused = not stream.needed and stream.tries >= _PATIENCE  # this is the last time
        if stream.by_group:
            stream.asked = StreamRequest("REQUEST_DATA_STREAM", stream.want_hz)
            every_hz = round(stream.want_hz)
            return dialect.MAVLink_request_data_stream_message(system, component, stream.group, every_hz, 1)
        self._pending = (stream, now)
        return command(system, component, _SET_INTERVAL, stream.ids[0], 1e6 / stream.want_hz)

    def _change_kind(self, stream: Stream, now: float) -> None:
        stream.by_group = not stream.by_group
        if stream.by_group and stream.tries <= _PATIENCE:  # only once
            self._emit(StreamAskedOtherwise, now, stream.name, *stream.asked, stream.want_hz)
        stream.next_ask = 0.0
