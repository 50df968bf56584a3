"""When a campaign's flights first hear somebody, and how many have found by then and there what the plan asks for.

    python tools/measure_first_signal.py configs/campaigns/pila.yaml [--seeds 200] [--within 90]

Flies the plan's trials one after the other: the time of the first signal, from the end of the take-off; the share that
hears one within that many seconds; the share that is found within the plan's limit and as near as it asks.
"""

from __future__ import annotations

import argparse
from statistics import median

from arva_hil.campaign.plan import trials
from arva_hil.campaign.results import wilson
from arva_hil.campaign.trial import Trial, fly
from arva_hil.config.campaign import load_plan
from arva_hil.search.mission.mission import FOUND
from arva_hil.search.mission.outcome import SearchStep


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan")
    parser.add_argument("--seeds", type=int, help="so many of the plan's; default all")
    parser.add_argument("--within", type=float, default=90.0, metavar="S", help="of the first signal; default 90")
    options = parser.parse_args()
    plan = load_plan(options.plan)
    every = [planned.trial for planned in trials(plan)][: options.seeds]
    heard, found = [], 0
    for trial in every:
        first_s, good = flown(trial, plan.success_m)
        heard.append(first_s)
        found += good
    told = sorted(first_s for first_s in heard if first_s is not None)
    soon = sum(first_s <= options.within for first_s in told)
    print(f"{len(every)} flights; first signal after {median(told):.1f} s in the median, {told[-1]:.1f} s at most")
    print(share(f"heard within {options.within:g} s", soon, len(every)))
    print(share(f"found within {plan.success_m:g} m and the limit", found, len(every)))


def flown(trial: Trial, success_m: float) -> tuple[float | None, bool]:
    """When it first heard somebody, None for never; whether it found what was asked for."""
    steps: list[SearchStep] = []
    result = fly(trial, steps.append)
    flying = [step for step in steps if step.phase == "flying"]
    first = next((step.time_s - flying[0].time_s for step in flying if step.d_cm is not None and step.d_cm > 0), None)
    return first, result.outcome == FOUND and result.error_m is not None and result.error_m <= success_m


def share(what: str, count: int, of: int) -> str:
    low, high = wilson(count, of)
    return f"{what}: {count} of {of}, {100 * count / of:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"


if __name__ == "__main__":
    main()
