"""What a person or a program sees of a run."""

from .printer import Lines, Printer, as_json, plain

__all__ = ["Lines", "Printer", "as_json", "plain"]
