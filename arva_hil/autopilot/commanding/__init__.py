"""Commanding an autopilot: who controls the vehicle, modes, acknowledgements, set-points."""
