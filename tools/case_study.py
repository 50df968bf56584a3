"""The paper's case study (section IV): its four cases flown by every strategy, figures 8–11 and the table.

    python tools/case_study.py [--out tools/figures] [--results DIR]

Flies `configs/campaigns/paper.yaml` into DIR (what is there already is not flown again), prints the table in
Markdown, and draws each case from a flight of each strategy from each of the four take-off heights.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator
from pathlib import Path

from arva_hil import config
from arva_hil.campaign import results
from arva_hil.campaign.plan import trials
from arva_hil.campaign.results import groups, summary
from arva_hil.campaign.trial import Trial, fly
from arva_hil.cli.main import main as arva_hil
from arva_hil.config.campaign import load_plan
from arva_hil.records.pictures.search import Track, draw_search
from arva_hil.search.mission.outcome import SearchStep

PLAN = Path(__file__).parents[1] / "configs/campaigns/paper.yaml"
CASES = {8: "paper_case_1", 9: "paper_case_2", 10: "paper_case_3", 11: "paper_case_4"}  # by figure
HEIGHTS_M = (1.0, 2.0, 3.0, 4.0)  # of the take-off
HEIGHT_M = 1.0  # held, as in the paper
DRAWN = ("flux", "estimate")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "figures")
    parser.add_argument("--results", type=Path, default=Path("paper-results"))
    options = parser.parse_args()
    if code := arva_hil(["campaign", str(PLAN), "--out", str(options.results)]):
        raise SystemExit(code)
    print("\n".join(table(options.results)))
    for figure, name in CASES.items():
        draw(figure, name, options.out / f"figure{figure}.png")


def table(folder: Path) -> Iterator[str]:
    """Success, time, path and error of every case and strategy, in Markdown."""
    plan = load_plan(PLAN)
    with results.opened(folder) as kept:
        rows = [kept.rows[planned.key] for planned in trials(plan)]
    yield "| case | strategy | found within 2 m | time, s | path, m | error, m | worst error, m |"
    yield "|---|---|---|---|---|---|---|"
    for (case, strategy), some in groups(rows, "scenario", "strategy").items():
        s = summary(some, plan.success_m)
        spread = [f"{pair[0]:.{n}f}" if pair else "" for pair, n in ((s.time_s, 0), (s.path_m, 0), (s.error_m, 2))]
        worst = max((row.error_m for row in some if row.error_m is not None), default=float("nan"))
        yield f"| {case} | {strategy} | {s.successes} of {s.runs} | {' | '.join(spread)} | {worst:.2f} |"


def draw(figure: int, name: str, path: Path) -> None:
    """One of the figures 8–11: a flight from each take-off height, with other noise each time."""
    chosen = config.load(str(PLAN.parents[1] / f"{name}.yaml"))
    (transmitter,) = chosen.transmitters
    assert transmitter.ned is not None
    north, east, _ = transmitter.ned
    tracks = []
    for strategy in DRAWN:
        for seed, height in enumerate(HEIGHTS_M, 1):
            rows: list[SearchStep] = []
            trial = Trial(strategy, dataclasses.replace(chosen, seed=seed), take_off_m=height, height_m=HEIGHT_M)
            fly(trial, rows.append)
            tracks.append(Track(strategy, rows))
    title = f"Case {figure - 7}: transmitter {east:g} m east, {north:g} m north; taken off to 1, 2, 3 and 4 m"
    draw_search(path, tracks, {transmitter.id: (north, east)}, transmitter.id, title)


if __name__ == "__main__":
    main()
