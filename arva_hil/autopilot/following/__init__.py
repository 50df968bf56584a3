"""One followed vehicle: its identity, streams, clock, checks of its values, and pose."""
