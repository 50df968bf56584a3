"""The bench for other people's tests: one emulated receiver, its vehicle and a clock that the test holds."""
