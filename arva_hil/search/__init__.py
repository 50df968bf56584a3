"""Searches for the transmitter: what an onboard computer flies by. `STRATEGIES` by the name a person gives them."""

from arva_hil.registry import STRATEGIES

__all__ = ["STRATEGIES"]
