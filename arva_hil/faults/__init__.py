"""Faults on purpose, in the order of the data's way: what is heard, what is sent and when, the bytes on the wire."""
