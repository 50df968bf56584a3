"""MAVLink as a codec: bytes in, packets out; messages in, bytes out."""
