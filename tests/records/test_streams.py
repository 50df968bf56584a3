"""The rates of a vehicle's messages: those of its own packets in the log of the link."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arva_hil.links.tlog import tlog_record
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.records.reading import load
from arva_hil.records.reading.streams import streams
from tests.made_records import EPOCH_US, write

ATTITUDE = dialect.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0)


def recorded(folder: Path, *strangers: tuple[int, int]) -> Path:
    """A record of vehicle 1/1 whose log has the same message once from every system and component."""
    senders = [Encoder(*ids) for ids in ((1, 1), *strangers)]
    log = (tlog_record(EPOCH_US + 2_500_000, sender.pack(ATTITUDE)) for sender in senders)
    (write(folder, 3, search=False) / "autopilot.tlog").write_bytes(b"".join(log))
    return folder


@pytest.mark.parametrize("stranger", [(1, 0), (1, 2), (0, 1), (2, 1), (2, 2)])
def test_packets_of_another_vehicle_or_component_are_not_counted(tmp_path: Path, stranger: tuple[int, int]) -> None:
    (stream,) = streams(load(recorded(tmp_path / "flight", stranger)))
    assert stream.hz.tolist() == [1.0]


@pytest.mark.parametrize("missing", ["system", "component"])
def test_all_packets_are_counted_if_the_record_does_not_say_whose_they_are(tmp_path: Path, missing: str) -> None:
    folder = recorded(tmp_path / "flight", (1, 0), (2, 1))
    run = json.loads((folder / "run.json").read_text())
    del run["vehicle"][missing]
    (folder / "run.json").write_text(json.dumps(run))
    (stream,) = streams(load(folder))
    assert stream.hz.tolist() == [3.0]
