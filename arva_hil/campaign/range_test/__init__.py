"""Range tests: a receiver is carried towards a transmitter until it hears it and goes on hearing it."""
