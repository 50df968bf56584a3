"""Reader of the records of `--record DIR`: readings, events, search and end of the run, as frozen values."""

from .folder import is_record, load
from .lines import RecordingError
from .recording import NO_ID, RecordedDatum, RecordedReceiver, RecordedRun, Recording
from .search import RecordedPlace, RecordedSearch

__all__ = [
    "NO_ID",
    "RecordedDatum",
    "RecordedPlace",
    "RecordedReceiver",
    "RecordedRun",
    "RecordedSearch",
    "Recording",
    "RecordingError",
    "is_record",
    "load",
]
