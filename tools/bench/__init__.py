"""Speed beside what a user would take instead, as ratios in one run: `python -m tools.bench`."""
