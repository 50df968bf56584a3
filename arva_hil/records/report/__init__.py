"""The report of runs: one page of HTML that needs nothing else, also for two runs side by side."""
