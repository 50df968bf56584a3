"""Hardware-in-the-loop emulator of an avalanche transceiver (ARVA) receiver."""

__version__ = "0.1.0"
