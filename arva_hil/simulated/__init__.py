"""The built-in vehicle: motion, autopilot, its MAVLink; and the closed loop around it."""
