"""Searches for the transmitter, as a program on an onboard computer. `registry.STRATEGIES` has the strategies."""

from arva_hil.registry import STRATEGIES

__all__ = ["STRATEGIES"]
