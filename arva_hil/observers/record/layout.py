"""The paths of the files in a record's folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

VERSION: Final = 1  # of the record, in run.json; a reader refuses a newer one
TLOG, FRAMES, TABLE, READINGS, EVENTS, RUN = FILES = (
    "autopilot.tlog",
    "frames.bin",
    "frames.csv",
    "readings.csv",
    "events.jsonl",
    "run.json",
)
_OF_RECEIVERS: Final = (FRAMES, TABLE, READINGS)


@dataclass(frozen=True)
class RecordLayout:
    """`receivers`: names of vehicle and receiver; `links`: the engine's names of the links that are recorded.

    The files of a single receiver are beside run.json, those of several in `VEHICLE/RECEIVER/`. The packets of a single
    link are in autopilot.tlog, those of several in autopilot-1.tlog, autopilot-2.tlog and so on.
    """

    receivers: tuple[tuple[str, str], ...] = ()
    links: tuple[str, ...] = ()

    def tlog(self, link: str) -> str:
        """The file of a link's packets."""
        return TLOG if len(self.links) < 2 else f"autopilot-{self.links.index(link) + 1}.tlog"

    def of_receiver(self, vehicle: str, receiver: str, file: str) -> str:
        """The path of one of a receiver's files in the record's folder."""
        return file if len(self.receivers) < 2 else f"{vehicle}/{receiver}/{file}"

    @property
    def folders(self) -> list[str]:
        """The folders to create, outer ones first."""
        if len(self.receivers) < 2:
            return []
        vehicles = dict.fromkeys(vehicle for vehicle, _ in self.receivers)
        return [*vehicles, *(f"{vehicle}/{receiver}" for vehicle, receiver in self.receivers)]

    @property
    def files(self) -> list[str]:
        """All files except run.json."""
        logs = [self.tlog(link) for link in self.links] or [TLOG]
        return [*logs, EVENTS, *(self.of_receiver(*names, file) for names in self._receivers for file in _OF_RECEIVERS)]

    @property
    def tables(self) -> list[str]:
        """Each receiver's frames.csv."""
        return [self.of_receiver(*names, TABLE) for names in self._receivers]

    @property
    def _receivers(self) -> Sequence[tuple[str, str]]:
        return self.receivers if len(self.receivers) > 1 else [("", "")]
