"""Reads what `--record DIR` has written: readings, events, the search and how the run ended, as frozen values."""

from .folder import is_record, load
from .lines import RecordingError
from .receivers import RecordedReceiver
from .recording import Datum, Recording, Run
from .search import Place, RecordedSearch

__all__ = [
    "Datum",
    "Place",
    "RecordedReceiver",
    "RecordedSearch",
    "Recording",
    "RecordingError",
    "Run",
    "is_record",
    "load",
]
