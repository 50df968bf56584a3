"""The autopilot's side: MAVLink as a codec, the session with one vehicle, its pose track, a simulated one."""
