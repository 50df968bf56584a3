"""Records of runs: writing, reading, and all that is made of them."""
