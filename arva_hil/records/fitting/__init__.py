"""Estimates the properties of a receiver and its transmitters from records of flights.

Needs scipy, which is imported when a fit begins.
"""

from .flight import FitError, RecordedFlight, flight_of
from .parameters import FittedValue, Parameter
from .result import ReceiverFit

__all__ = ["FitError", "FittedValue", "Parameter", "ReceiverFit", "RecordedFlight", "flight_of"]
