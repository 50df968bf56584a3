"""Output of a run for a person or a program."""

from .printer import Lines, Printer, as_json, plain

__all__ = ["Lines", "Printer", "as_json", "plain"]
