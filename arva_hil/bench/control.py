"""The control port of a bench, for programs in any language: JSON lines in and out."""

from __future__ import annotations

import contextlib
import json
import os
import re
import selectors
import socket
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, Final, NamedTuple

from arva_hil.bench.bench import Bench
from arva_hil.bench.ports import BenchError
from arva_hil.clock import Clock, Waitable
from arva_hil.errors import ArvaError
from arva_hil.events.words.text import frame_json

LONGEST_LINE: Final = 65536  # bytes
MOST_FRAMES: Final = 1000  # in one answer

_PATIENCE_S: Final = 1.0  # for a client that does not read its answers
_LOOK_S: Final = 0.1
_TCP: Final = re.compile(r"tcp:(127\.0\.0\.1|localhost):(\d{1,5})")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


_FITS: Final[Mapping[str, Callable[[Any], bool]]] = {  # by the type of a key: True for a value of it
    "string": lambda value: isinstance(value, str),
    "number": _is_number,
    "whole number from 0": lambda value: _is_number(value) and isinstance(value, int) and value >= 0,
    "list of points": lambda value: (
        isinstance(value, list) and all(isinstance(point, list) and all(map(_is_number, point)) for point in value)
    ),
}


class Key(NamedTuple):
    """A key of a request: the kind of its value, and whether a request must have it."""

    kind: str
    needed: bool = True


_NED: Final = {name: Key("number") for name in ("north", "east", "down")}
REQUESTS: Final[Mapping[str, Mapping[str, Key]]] = {
    "place": {**_NED, "yaw": Key("number", needed=False)},
    "fly": {"points": Key("list of points")},
    "inject": {"fault": Key("string")},
    "clear": {},
    "advance": {"seconds": Key("number")},
    "truth": {},
    "frames": {"since": Key("whole number from 0", needed=False)},
    "unplug": {},
    "replug": {},
    "power_cycle": {},
    "stop": {},
}
"""The keys of each request, by the value of `do`."""


def answered(bench: Bench, line: bytes) -> tuple[dict[str, Any], str]:
    """Do one request. Returns its answer, and its name, "" if it is wrong; a wrong request changes nothing."""
    name = ""
    try:
        name, keys = _parsed(line)
        return {"ok": True, **_do(bench, name, keys)}, name
    except (ArvaError, ValueError) as error:
        return {"ok": False, "error": str(error)}, name


def _parsed(line: bytes) -> tuple[str, dict[str, Any]]:
    """Read a request: its name and its keys. Raises BenchError."""
    try:
        request = json.loads(line, parse_constant=_refuse)
    except (ValueError, RecursionError):
        raise BenchError('this is no JSON line: write one object a line, e.g. {"do": "truth"}') from None
    if not isinstance(request, dict):
        raise BenchError('this is no JSON object: write e.g. {"do": "truth"}')
    name = request.pop("do", None)
    if not isinstance(name, str) or name not in REQUESTS:
        raise BenchError(f"do: {name!r}, expected one of {', '.join(REQUESTS)}")
    keys = REQUESTS[name]
    for key in request:
        if key not in keys:
            raise BenchError(f"{name}: unknown key {key!r}, expected {', '.join(keys) or 'none'}")
    for key, one in keys.items():
        if one.needed and key not in request:
            raise BenchError(f"{name}: no key {key!r}")
        if key in request and not _FITS[one.kind](request[key]):
            raise BenchError(f"{name}: {key} is {str(request[key])[:40]!r}, expected a {one.kind}")
    return name, request


def _refuse(constant: str) -> float:
    raise ValueError(constant)


def _do(bench: Bench, name: str, keys: Mapping[str, Any]) -> dict[str, Any]:
    if name == "advance":
        bench.advance(keys["seconds"])
        return {"time_s": bench.now(), "frames": len(bench.frames)}
    if name == "truth":
        return asdict(bench.truth())
    if name == "frames":
        since = keys.get("since", 0)
        frames = bench.frames[since : since + MOST_FRAMES]
        made = [
            {"number": one.number, "time_s": one.instant_s, "sent": one.sent, **frame_json(one.frame)} for one in frames
        ]
        return {"frames": made, "next": since + len(frames)}
    if name != "stop":
        getattr(bench, "place_vehicle" if name == "place" else name)(**keys)
    return {}


class ControlServer:
    """Serves one client after the other. A task of the loop. Remembers whether a client has sent `stop`.

    `address`: tcp:127.0.0.1:PORT, with 0 for a free port, or unix:PATH. Raises BenchError if it cannot listen there.
    """

    def __init__(self, bench: Bench, address: str) -> None:
        self.stopped = False
        self._bench = bench
        self._path = ""
        self._client: socket.socket | None = None
        self._bytes = b""
        self._too_long = False
        try:
            self._listener, self.address = self._listen(address)
        except (OSError, OverflowError) as error:
            raise BenchError(f"{address}: cannot listen there: {getattr(error, 'strerror', None) or error}") from error
        self._listener.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)

    def _listen(self, address: str) -> tuple[socket.socket, str]:
        if match := _TCP.fullmatch(address):
            listener = socket.create_server(("127.0.0.1", int(match[2])))
            return listener, f"tcp:127.0.0.1:{listener.getsockname()[1]}"
        if address.startswith("unix:") and len(address) > len("unix:") and hasattr(socket, "AF_UNIX"):
            listener = socket.socket(socket.AF_UNIX)
            try:
                listener.bind(address.removeprefix("unix:"))
                self._path = address.removeprefix("unix:")
                os.chmod(self._path, 0o600)
                listener.listen()
            except BaseException:
                listener.close()
                raise
            return listener, address
        raise BenchError(f"{address!r} is no control port: write tcp:127.0.0.1:5457 or unix:/tmp/arva.control")

    @property
    def links(self) -> list[Waitable]:
        return [self]

    def fileno(self) -> int | None:
        """Return the descriptor to wait on; None if there is none."""
        fileno = getattr(self._selector, "fileno", None)
        return fileno() if fileno else None

    def ready(self) -> bool:
        """Return True if a client has come or has sent something."""
        return bool(self._selector.select(0))

    def service(self, clock: Clock) -> float:
        """Answer the requests of the client."""
        for key, _ in self._selector.select(0):
            if key.fileobj is self._listener:
                self._accept()
            else:
                self._read()
        return clock.now() + _LOOK_S

    def close(self) -> None:
        """Close the port, and remove the file of a Unix socket."""
        self._leave()
        self._selector.close()
        self._listener.close()
        if self._path:
            with contextlib.suppress(OSError):
                os.unlink(self._path)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            client, _ = self._listener.accept()
            client.settimeout(_PATIENCE_S)
            if self._client is None:
                self._client, self._bytes, self._too_long = client, b"", False
                self._selector.register(client, selectors.EVENT_READ)
                return
            with client:
                client.sendall(_line({"ok": False, "error": "another client is connected: close it first"}))

    def _read(self) -> None:
        assert self._client is not None
        try:
            chunk = self._client.recv(LONGEST_LINE)
        except OSError:
            chunk = b""
        if not chunk:
            self._leave()
            return
        *lines, self._bytes = (self._bytes + chunk).split(b"\n")
        for line in lines:
            too_long, self._too_long = self._too_long or len(line) > LONGEST_LINE, False
            said, name = (_TOO_LONG, "") if too_long else answered(self._bench, line)
            if not self._say(said):
                return
            if name == "stop":
                self.stopped = True
                return
        if len(self._bytes) > LONGEST_LINE:
            self._bytes, self._too_long = b"", True

    def _say(self, said: Mapping[str, Any]) -> bool:
        """Answer the client. Returns False if it has left."""
        try:
            assert self._client is not None
            self._client.sendall(_line(said))
            return True
        except OSError:
            self._leave()
            return False

    def _leave(self) -> None:
        if self._client is not None:
            self._selector.unregister(self._client)
            self._client.close()
            self._client = None


_TOO_LONG: Final = {"ok": False, "error": f"the line is longer than {LONGEST_LINE} bytes"}


def _line(said: Mapping[str, Any]) -> bytes:
    return json.dumps(said).encode() + b"\n"
