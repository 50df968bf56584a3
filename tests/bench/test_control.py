"""The control port: JSON lines in and out, and no wrong line changes anything."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import arva_hil.bench
from arva_hil import Bench, BenchError
from arva_hil.bench.control import LONGEST_LINE, REQUESTS, ControlServer, answered
from arva_hil.clock import StepClock
from tests.every import every


@pytest.fixture
def bench() -> Iterator[Bench]:
    with Bench(port="memory") as made:
        yield made


SCHEMA = json.loads((Path(arva_hil.bench.__file__).parent / "control.schema.json").read_text(encoding="utf-8"))


def is_a(kind: str, line: Any) -> bool:
    """True for a line of this kind by the schema."""
    return bool(jsonschema.Draft202012Validator({**SCHEMA, "oneOf": [{"$ref": f"#/$defs/{kind}"}]}).is_valid(line))


def ask(bench: Bench, **request: Any) -> dict[str, Any]:
    """Ask what is right, and by the schema as well."""
    assert is_a("request", request)
    line = json.dumps(said := answered(bench, json.dumps(request).encode())[0])
    kinds = {"advance": "advanced", "truth": "true_state", "frames": "made_frames"}
    assert is_a(kinds.get(request["do"], "done"), json.loads(line))
    return said


def test_each_request_does_what_the_bench_does(bench: Bench) -> None:
    assert ask(bench, do="place", north=15, east=5, down=-2, yaw=90) == {"ok": True}
    assert ask(bench, do="advance", seconds=2) == {"ok": True, "time_s": 2.0, "frames": 2}
    truth = ask(bench, do="truth")
    assert (truth["ned"], round(truth["ranges_m"][1], 3)) == ((15, 5, -2), 5.385)
    frames = ask(bench, do="frames", since=1)
    assert frames["next"] == 2
    assert [(one["number"], one["seq"], one["sent"]) for one in frames["frames"]] == [(1, 1, True)]
    assert ask(bench, do="inject", fault="silence") == {"ok": True}
    assert ask(bench, do="advance", seconds=1)["ok"]
    assert not bench.frames[-1].sent
    for do in ("clear", "unplug", "replug", "power_cycle", "stop"):
        assert ask(bench, do=do) == {"ok": True}
    assert ask(bench, do="fly", points=[[0, 0, 0, -3], [5, 5, 0, -3]]) == {"ok": True}
    assert ask(bench, do="advance", seconds=1)["ok"]
    assert bench.frames[-1].frame.sequence == 0
    assert {one.frame.sequence for one in bench.frames} == {0, 1, 2}
    assert len(REQUESTS) == 11


@every(
    "line, error",
    [
        ("", "no JSON line"),
        ("x", "no JSON line"),
        ("[" * 50_000, "no JSON line"),
        ("[]", "no JSON object"),
        ("{}", "do: None, expected one of place, fly,"),
        ('{"do": ["place"]}', "expected one of place"),
        ('{"do": "place", "north": 1, "east": 2}', "place: no key 'down'"),
        ('{"do": "place", "north": "1", "east": 2, "down": 3}', "place: north is '1', expected a number"),
        ('{"do": "place", "north": NaN, "east": 2, "down": 3}', "no JSON line"),
        ('{"do": "place", "north": 1e999, "east": 2, "down": 3}', "place_vehicle: inf"),
        ('{"do": "place", "north": 1%s, "east": 2, "down": 3}' % ("0" * 400), "place_vehicle: 1000"),
        ('{"do": "place", "north": true, "east": 2, "down": 3}', "expected a number"),
        ('{"do": "advance", "seconds": 1e9}', "expected 0…1e+06 seconds"),
        ('{"do": "advance", "second": 1}', "unknown key 'second', expected seconds"),
        ('{"do": "truth", "now": 1}', "unknown key 'now', expected none"),
        ('{"do": "frames", "since": -1}', "since is '-1', expected a whole number from 0"),
        ('{"do": "inject", "fault": "dorp=1"}', "did you mean 'drop'"),
        ('{"do": "fly", "points": [[0, 0]]}', "each point"),
        ('{"do": "fly", "points": 3}', "expected a list of points"),
    ],
)
def test_a_wrong_line_gets_an_error_and_changes_nothing(bench: Bench, line: str, error: str) -> None:
    said, _ = answered(bench, line.encode())
    assert is_a("error", said)
    if error not in ("no JSON line", "did you mean 'drop'"):  # of which a schema knows nothing
        assert not is_a("request", json.loads(line))
    assert error in said["error"]
    assert (bench.truth().ned, bench.now(), len(bench.frames)) == ((0.0, 0.0, -3.0), 0.0, 0)


def _lines(server: ControlServer, client: socket.socket, data: bytes, count: int = 1) -> list[dict[str, Any]]:
    if data:
        client.sendall(data)
    got = b""
    for _ in range(50):
        server.service(StepClock())
        client.settimeout(0.02)
        try:
            got += client.recv(1 << 20)
        except TimeoutError:
            continue
        if got.count(b"\n") >= count:
            break
    return [json.loads(line) for line in got.splitlines()]


@every("kind", ["tcp", "unix"])
def test_one_client_at_a_time_and_lines_of_bounded_length(bench: Bench, tmp_path: Path, kind: str) -> None:
    address = "tcp:127.0.0.1:0" if kind == "tcp" else f"unix:{tmp_path}/control"
    with closing(ControlServer(bench, address)) as server:

        def connect() -> socket.socket:
            if kind == "unix":
                client = socket.socket(socket.AF_UNIX)
                client.connect(f"{tmp_path}/control")
                return client
            return socket.create_connection(("127.0.0.1", int(server.address.rpartition(":")[2])))

        truth = b'{"do": "truth"}\n'
        with connect() as first, connect() as second:
            assert _lines(server, first, truth + b"x\n", 2)[1]["ok"] is False
            assert "another client" in _lines(server, second, b"")[0]["error"]
            (long,) = _lines(server, first, b"x" * (LONGEST_LINE + 10) + b"\n")
            assert "longer than 65536 bytes" in long["error"]
            assert _lines(server, first, truth)[0]["ok"]
        server.service(StepClock())
        with connect() as third:
            assert _lines(server, third, truth)[0]["ok"]
            assert _lines(server, third, b'{"do": "stop"}\n')[0]["ok"]
        assert server.stopped
    assert not (tmp_path / "control").exists()


@every("address", ["tcp:127.0.0.1:65536", f"unix:/tmp/{'x' * 200}"])
def test_an_address_that_cannot_be_is_refused_with_the_reason(bench: Bench, address: str) -> None:
    with pytest.raises(BenchError, match=r"cannot listen there: (?!None)"):
        ControlServer(bench, address)


@every("address", ["tcp:0.0.0.0:5000", "tcp:10.0.0.1:5000", "udp:127.0.0.1:5000", "unix:", "unix:/none/control", ""])
def test_it_listens_on_this_machine_alone(bench: Bench, address: str) -> None:
    with pytest.raises(BenchError, match=r"control|listen"):
        ControlServer(bench, address)
