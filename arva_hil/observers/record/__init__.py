"""The record of a run, for tools such as QGroundControl, PlotJuggler and spreadsheets."""

from .layout import RecordLayout
from .recorder import Recorder, RecordError
from .tables import COLUMNS

__all__ = ["COLUMNS", "RecordError", "RecordLayout", "Recorder"]
