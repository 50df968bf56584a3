"""The record of a run, for tools such as QGroundControl, PlotJuggler and spreadsheets."""

from .growing_files import RecordError
from .layout import COLUMNS, RecordLayout
from .recorder import Recorder

__all__ = ["COLUMNS", "RecordError", "RecordLayout", "Recorder"]
