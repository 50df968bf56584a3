"""Faults on purpose: of hearing, of sending, and of the bytes on the wire."""
