"""Where the time goes in a replay and in closed loops: the share of each function, with all that it calls.

    python tools/measure_shares.py flight.tlog [--times 40] [--least 2]

Looks at the processor's time again and again, at what is being done: some 250 times a second. Start-up is not counted.
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import signal
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, suppress
from io import StringIO
from pathlib import Path
from types import FrameType

from arva_hil.campaign.trial import Trial, fly
from arva_hil.cli.main import main as command
from tools.measure_search import CASES

_EVERY_S = 1e-3  # asked for; the system looks less often


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flight")
    parser.add_argument("--times", type=int, default=40, help="each")
    parser.add_argument("--least", type=float, default=2.0, metavar="PERCENT", help="of what is printed")
    options = parser.parse_args()

    def replayed(seed: int) -> None:
        with suppress(SystemExit), redirect_stderr(StringIO()):
            command(["replay", options.flight, "--out", "/dev/null"])

    def searched(seed: int) -> None:
        fly(Trial("flux", dataclasses.replace(CASES[seed % 4], seed=seed)))

    for name, work in (("replay", replayed), ("closed loop, flux", searched)):
        work(0)
        gc.freeze()  # as the commands do
        tell(name, shares(lambda work=work: [work(seed) for seed in range(options.times)]), options.least)


def shares(work: Callable[[], object]) -> Counter[str]:
    """How often each function was being done; under "" how often that was looked at."""
    seen: Counter[str] = Counter()

    def look(_: int, frame: FrameType | None) -> None:
        names = {""}
        while frame is not None:
            code = frame.f_code
            names.add(f"{'/'.join(Path(code.co_filename).parts[-2:])}: {code.co_qualname}")
            frame = frame.f_back
        seen.update(names)

    signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, _EVERY_S, _EVERY_S)
    work()
    signal.setitimer(signal.ITIMER_PROF, 0)
    return seen


def tell(name: str, seen: Counter[str], least: float) -> None:
    count = seen.pop("")
    print(f"{name}: {count} samples")
    for function, times in seen.most_common():
        if 100 * times >= least * count:
            print(f"{100 * times / count:6.1f} %  {function}")


if __name__ == "__main__":
    main()
