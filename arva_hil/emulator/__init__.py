"""The emulator: the engine and what it is made of. Bytes and time in; bytes, deadlines and events out."""
