"""The record of a run, for the tools that others use: QGroundControl, PlotJuggler, a spreadsheet."""

from .layout import RecordLayout
from .recorder import Recorder, RecordError
from .tables import COLUMNS

__all__ = ["COLUMNS", "RecordError", "RecordLayout", "Recorder"]
