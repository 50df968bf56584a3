"""Strategies: from readings of one transmitter to velocities and a place."""
