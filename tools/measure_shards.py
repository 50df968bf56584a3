"""A campaign of 100,000 trials on a Dask cluster of this machine whose workers and scheduler are killed: what the
scheduler's memory does, what a trial costs beside its flight, and whether every result is there once.

    python tools/measure_shards.py [TRIALS] [--keep-alive]

The flights are fakes that take no time: all that is measured is what is around them. `--keep-alive` kills nothing:
then the scheduler's memory is that of one process.
"""

from __future__ import annotations

import argparse
import os
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parent.parent
TESTS = ROOT / "tests"
ADDRESS = "tcp://127.0.0.1:18786"
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (TESTS, ROOT)))}
CAMPAIGN = """
import sys
from arva_hil.campaign import trial
from arva_hil.cli.main import main
from campaign import fakes
trial.fly = fakes.fake
sys.exit(main(sys.argv[1:]))
"""
TICKS = os.sysconf("SC_CLK_TCK")


def start(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, *arguments], env=ENVIRONMENT, stderr=subprocess.DEVNULL)


def scheduler() -> subprocess.Popen[bytes]:
    port = ADDRESS.rpartition(":")[2]
    return start("-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--host", "127.0.0.1", "--port", port)


def worker() -> subprocess.Popen[bytes]:
    return start("-m", "distributed.cli.dask_worker", ADDRESS, "--no-dashboard", "--no-nanny", "--nthreads", "1")


def resident_mb(process: subprocess.Popen[bytes]) -> float:
    return int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def cpu_s(process: subprocess.Popen[bytes]) -> float:
    user, system = Path(f"/proc/{process.pid}/stat").read_text().rpartition(") ")[2].split()[11:13]
    return (int(user) + int(system)) / TICKS


def rows(folder: Path) -> int:
    """How many results there are; read past the lock."""
    try:
        with closing(sqlite3.connect(f"file:{folder / 'results.sqlite'}?immutable=1", uri=True)) as database:
            return int(database.execute("SELECT count(*) FROM results").fetchone()[0])
    except sqlite3.DatabaseError:
        return 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("trials", type=int, nargs="?", default=100_000)
    parser.add_argument("--keep-alive", action="store_true", help="kill nothing")
    options = parser.parse_args()
    trials = options.trials
    with TemporaryDirectory() as name:
        folder = Path(name)
        plan = folder / "plan.yaml"
        plan.write_text(
            f"strategies: [flux, estimate]\nscenarios: {{random: {{within_m: 50}}}}\nseeds: {trials // 2}\n"
        )
        running, workers = scheduler(), [worker(), worker()]
        program = start("-c", CAMPAIGN, "campaign", str(plan), "--out", str(folder / "r"), "--scheduler", ADDRESS)
        kills = {} if options.keep_alive else {0.3: "a worker", 0.6: "the scheduler and its workers"}
        spent, peak, next_print, began = 0.0, 0.0, 0.0, time.monotonic()
        campaign_s = 0.0
        while program.poll() is None:
            done = rows(folder / "r") / trials
            peak = max(peak, resident_mb(program))
            campaign_s = cpu_s(program)
            if done >= next_print:
                print(f"{done:5.0%}  scheduler {resident_mb(running):4.0f} MB  campaign {resident_mb(program):4.0f} MB",
                      flush=True)  # fmt: skip
                next_print = done + 0.1
            if kills and done >= min(kills):
                print(f"{done:5.0%}  killed: {(what := kills.pop(min(kills)))}", flush=True)
                workers.pop().kill()
                if "scheduler" in what:
                    spent += cpu_s(running)
                    running.kill()
                    running.wait()
                    workers.pop().kill()
                    running = scheduler()
                    workers.append(worker())
                workers.append(worker())
            time.sleep(0.2)
        spent += cpu_s(running)
        for process in [running, *workers]:
            process.kill()
        with closing(sqlite3.connect(folder / "r" / "results.sqlite")) as database:
            count, distinct = database.execute("SELECT count(*), count(DISTINCT key) FROM results").fetchone()
        print(f"exit code {program.returncode}, {time.monotonic() - began:.0f} s; {count} results of {trials} trials, "
              f"{distinct} different")  # fmt: skip
        print(f"a trial beside its flight: scheduler {1e3 * spent / trials:.2f} ms of CPU, campaign "
              f"{1e3 * campaign_s / trials:.2f} ms; campaign's memory at most {peak:.0f} MB")  # fmt: skip


if __name__ == "__main__":
    main()
