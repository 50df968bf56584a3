"""The record of a run, for the tools that others use: QGroundControl, PlotJuggler, a spreadsheet."""

from .layout import Layout
from .recorder import COLUMNS, Recorder, RecordError

__all__ = ["COLUMNS", "Layout", "RecordError", "Recorder"]
