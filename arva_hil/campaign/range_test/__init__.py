"""Range tests: a receiver is carried towards a transmitter until its signal is stable."""
