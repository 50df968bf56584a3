"""Faults on purpose: of reception, of sending, and of the bytes on the wire."""
