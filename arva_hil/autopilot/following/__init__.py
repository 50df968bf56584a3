"""One vehicle followed: which one, its streams, its clock, what of it is believed, where it is."""
