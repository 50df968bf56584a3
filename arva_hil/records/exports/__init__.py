"""Writes records in the formats of other programs: one module a format, by name in `arva_hil.registry.EXPORTS`.

A format is a function `write(recording, out)`: it writes a `Recording` to a binary file from its beginning to its end.
"""
