"""The MAVLink codec: bytes to packets, messages to bytes."""
