"""Searches for the transmitter, as a program on an onboard computer. `registry.STRATEGIES` has the strategies."""
