"""Speed compared with that of other libraries, as ratios in one run: `python -m tools bench`."""
