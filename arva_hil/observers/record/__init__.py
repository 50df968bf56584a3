"""The record of a run, for tools such as QGroundControl, PlotJuggler and spreadsheets."""

from .layout import COLUMNS, RecordLayout
from .recorder import Recorder, RecordError

__all__ = ["COLUMNS", "RecordError", "RecordLayout", "Recorder"]
