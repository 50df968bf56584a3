"""The bench for other people's tests: one emulated receiver, its vehicle, and a clock under the control of the test."""
