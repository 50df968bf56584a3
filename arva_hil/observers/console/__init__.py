"""Output of a run for a person or a program."""

from .printer import LinePrinter, Printer, as_json, plain

__all__ = ["LinePrinter", "Printer", "as_json", "plain"]
