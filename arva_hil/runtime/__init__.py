"""Runs an engine: the clock, the drivers, the loop, the worker thread."""
