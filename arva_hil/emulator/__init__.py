"""The emulator: the engine and its parts. Bytes and time in; bytes, deadlines and events out."""
