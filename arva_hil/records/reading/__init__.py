"""Reader of the records of `--record DIR`: readings, events, search and end of the run, as frozen values."""

from .folder import is_record, load
from .lines import Lines, RecordingError, mapping, notice_of, number, objects, refuse_no_file, table, text
from .recording import NO_ID, RecordedDatum, RecordedReceiver, RecordedRun, Recording, received
from .search import RecordedPlace, RecordedSearch
from .streams import RecordedStream, logged, packets, streams

__all__ = [
    "NO_ID",
    "Lines",
    "RecordedDatum",
    "RecordedPlace",
    "RecordedReceiver",
    "RecordedRun",
    "RecordedSearch",
    "RecordedStream",
    "Recording",
    "RecordingError",
    "is_record",
    "load",
    "logged",
    "mapping",
    "notice_of",
    "number",
    "objects",
    "packets",
    "received",
    "refuse_no_file",
    "streams",
    "table",
    "text",
]
