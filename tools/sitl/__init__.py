"""Flights on ArduPilot's and PX4's simulators: what fly_simulators.py is made of."""
