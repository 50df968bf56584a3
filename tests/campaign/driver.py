"""The program with a fake instead of the flight, and a report without charts: `driver.py FAKE ARGUMENTS…`."""

from __future__ import annotations

import sys
from pathlib import Path

from arva_hil.campaign import charts, runner, trial
from arva_hil.cli.main import main

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[2])]
    from tests.campaign import fakes

    trial.fly = getattr(fakes, sys.argv[1])
    charts.draw = lambda rows, success_m: {}
    runner._AHEAD = 100  # or a cluster would need thousands of trials before a worker gets several together
    sys.exit(main(sys.argv[2:]))
