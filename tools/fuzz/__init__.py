"""Fuzzing of readers: `python -m tools.fuzz.python TARGET`, and of the C code `python -m tools.fuzz.c`.

A target in Python is a module: `fuzz(data)` takes any bytes and fails by an exception; `seeds()` has first inputs.
"""
