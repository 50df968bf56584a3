"""The emulator live, in a process that does nothing else, like `arva-hil run` and the peer of the bench.

    python -m tools.bench.alone AUTOPILOT HZ SECONDS

Prints the loop's CPU time [s]. `cat` reads the frames. The first two seconds do
not count: the time of a start is another row.
"""

from __future__ import annotations

import gc
import subprocess
import sys
import time
from contextlib import closing
from typing import Final

from arva_hil.autopilot.following.session import Session
from arva_hil.clock import RealClock
from arva_hil.config import parse
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.setup import one_vehicle
from arva_hil.links import open_link
from arva_hil.links.pty import PtyLink
from arva_hil.runtime.audience import Audience
from arva_hil.runtime.drivers import Live
from arva_hil.runtime.loop import run

WARM_S: Final = 2.0


def main(device: str, hz: float, seconds: float) -> None:
    scenario = parse(f"transmitters: [{{id: 1, ned: [20, 5, 0]}}]\nreceiver: {{rate_hz: {hz}}}", "bench")
    clock = RealClock()
    with closing(PtyLink()) as port, closing(open_link(device, clock=clock)) as link:
        reader = subprocess.Popen(["cat", port.path], stdout=subprocess.DEVNULL)
        begin = clock.now()
        emulator = Emulator([one_vehicle(scenario, Session())], start=begin)
        live = Live(emulator, {"autopilot": link}, {"port": port}, Audience([]))
        gc.freeze()  # as the commands do
        run([live], clock, until=begin + WARM_S)
        start = time.process_time()
        run([live], clock, until=begin + WARM_S + seconds)
        print(time.process_time() - start)
        reader.kill()
        reader.wait()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), float(sys.argv[3]))
