"""The built-in vehicle: motion, autopilot, its MAVLink; and the closed loop around it."""

HOME = (46.0123, 7.7456, 1650.0)  # degrees, degrees, metres AMSL
