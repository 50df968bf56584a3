"""Flights on ArduPilot's and PX4's simulators: the parts of fly_simulators.py."""
