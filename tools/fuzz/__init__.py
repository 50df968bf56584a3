"""Fuzzing of readers in Python and C, random streams for all decoders, attacks on sessions and searches.

A target in Python is a module: `fuzz(data)` takes any bytes and fails by an exception; `seeds()` has first inputs.
"""
