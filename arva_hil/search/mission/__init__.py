"""The mission of one search: which transmitter, how high, and when it ends."""
