"""Commanding an autopilot: who has the vehicle, modes, acknowledgements, set-points."""
