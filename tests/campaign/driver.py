"""The program with a fake instead of the flight: `driver.py FAKE ARGUMENTS…`."""

from __future__ import annotations

import sys
from pathlib import Path

from arva_hil.campaign import trial
from arva_hil.cli.main import main

if __name__ == "__main__":
    tests = Path(__file__).parent.parent
    sys.path[:0] = [str(tests.parent), str(tests)]
    from campaign import fakes

    trial.fly = getattr(fakes, sys.argv[1])
    sys.exit(main(sys.argv[2:]))
