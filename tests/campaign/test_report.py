"""The report: its numbers against others' and by hand, its page whole and by itself."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.campaign import charts, report
from arva_hil.campaign.results import TrialRow, differences, groups, matched, row, student, summary, wilson
from tests.said import says
from tests.undrawn import undrawn

from .fakes import fake, planned

ROWS = [row(one, fake(one.trial)) for one in planned()]
ONE = ROWS[0]


def runs(*errors: float | None, strategy: str = "flux", **others: object) -> list[TrialRow]:
    """A run for each error, of time 10 s, 20 s …; None did not find anything."""
    return [
        replace(
            ONE,
            strategy=strategy,
            outcome="lost" if error is None else "found",
            error_m=error,
            time_s=10.0 * n,
            path_m=9.0 * n,
            **others,
        )
        for n, error in enumerate(errors, 1)
    ]


@given(st.integers(1, 2000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_is_wilsons(counts: tuple[int, int]) -> None:
    expected = scipy.stats.binomtest(*counts).proportion_ci(method="wilson")
    assert wilson(*counts) == pytest.approx((expected.low, expected.high), abs=1e-12)


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 9, 99, 200_000])
def test_the_interval_of_a_mean_is_students(freedom: int) -> None:
    assert student(freedom) == pytest.approx(scipy.stats.t.ppf(0.975, freedom), rel=1e-5)


def test_of_nothing_nothing_is_known() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    assert (summary([], 2.0).runs, summary([], 2.0).time_s) == (0, None)


def test_sums_are_those_worked_out_by_hand() -> None:
    crash = replace(ONE, outcome="failed: OSError: x", error_m=None)
    s = summary([*runs(0.5, 1.0, 2.0, 5.0, None), crash], success_m=2.0)
    assert (s.runs, s.successes, s.rate) == (6, 3, 0.5)
    assert (s.time_s, s.path_m) == (pytest.approx((20.0, 28.0)), pytest.approx((18.0, 25.2)))
    assert s.earth.error_m == pytest.approx((1.5, 4.1))  # the place 5 m off was reported, too


def test_the_table_has_a_line_for_each_strategy_with_its_interval() -> None:
    rows = runs(0.5, 1.0, None, 9.0) + runs(None, None, strategy="estimate")
    head, flux, estimate, foot, compared, _ = report.text(rows, 2.0).split("\n")
    columns = "strategy runs successes rate 95 % confidence time, s path, m"
    places = " ".join(f"error {frame}, m ±, m in 1σ / 2σ false" for frame in ("on Earth", "from the drone"))
    assert head.split() == f"{columns} {places}".split()
    assert flux.split("  ")[0] == "flux"
    assert re.split(r"\s{2,}", flux)[1:5] == ["4", "2", "50.0 %", "15.0–85.0 %"]
    nothing = [*"–––", "0 / 0"]
    assert re.split(r"\s{2,}", flux)[5:] == ["15 / 19", "14 / 17", "1.00 / 7.40", *"––", "1 / 0", *nothing]
    assert re.split(r"\s{2,}", estimate) == ["estimate", "2", "0", "0.0 %", "0.0–65.8 %", *"––", *nothing, *nothing]
    assert "within 2 m" in foot
    assert compared.startswith("estimate against flux on 1 trials: success ")
    assert compared.endswith(", time of fewer than two pairs of successes")


@pytest.mark.usefixtures("uncharted")
def test_a_place_found_has_its_error_relative_to_the_vehicle_beside_that_on_earth() -> None:
    rows = runs(2.5, 2.5, sigma_m=2.0, relative_m=0.5, relative_sigma_m=0.1)
    expected = ["2.50 / 2.50", "2.00 / 2.00", "0 / 100 %", "2 / 0"]
    expected += ["0.50 / 0.50", "0.10 / 0.10", "0 / 0 %", "0 / 2"]
    assert re.split(r"\s{2,}", report.text(rows, 2.0).split("\n")[1])[7:] == expected
    assert cells(report.page("p", rows, 2.0), "By strategy")[0][7:] == expected


@pytest.mark.usefixtures("uncharted")
def test_differences_are_of_pairs_and_the_table_is_latex() -> None:
    flux = [replace(one, seed=n) for n, one in enumerate(runs(0.5, 1.0, None, 9.0))]
    other = [  # at its own speed
        replace(one, seed=n, time_s=one.time_s + n)
        for n, one in enumerate(runs(0.5, 1.0, 1.0, 9.0, strategy="a_b", speed_m_s=2.0, height_m=5.0, limit_s=99.0))
    ]
    (one,) = differences([*flux, *other, replace(ONE, seed=99, strategy="a_b")], 2.0)
    assert (one.strategy, one.other, one.trials) == ("a_b", "flux", 4)
    half = 1.959963984540054 * math.sqrt(2 - 1 / 6) / 6
    assert one.success == pytest.approx((0.25, 1 / 6 - half, 1 / 6 + half))
    assert matched(40, 20, 160) == pytest.approx((0.125, 0.03089632, 0.21601726))  # as R's PropCIs::diffpropci.mp
    assert matched(0, 0, 3) == pytest.approx((0, -0.392, 0.392), abs=1e-3)  # three pairs alike prove little
    assert one.time_s == pytest.approx((0.5, 0.5 - 12.7062047 / 2, 0.5 + 12.7062047 / 2))  # Student's: two values
    table = report.latex([*flux, *other], 2.0)
    says(
        table,
        r"a\_b & 4 & 3 & 75.0 \% & 30.1--95.4 \% &",
        f"% {(compared := 'a_b against flux on 4 trials: success +25.0 points, 95 % from -27.6 to +60.9')}",
    )
    assert f"\n{compared}, time +0 s, 95 % from -6 to +7" in report.text([*flux, *other], 2.0)
    assert f"{compared}, time +0 s, 95 % from -6 to +7." in report.page("p", [*flux, *other], 2.0)
    assert table.isascii()


def test_each_number_of_drones_has_a_line_in_both_tables() -> None:
    rows = runs(0.5, None) + runs(0.5, 0.5, 0.5, drones=4)
    expected = [["flux, 1 drone", "2", "1"], ["flux, 4 drones", "3", "3"]]
    assert [re.split(r"\s{2,}", line)[:3] for line in report.text(rows, 2.0).split("\n")[1:3]] == expected
    lines = [line for line in report.latex(rows, 2.0).split("\n") if line.startswith("flux")]
    assert [line.split(" & ")[:3] for line in lines] == expected


@pytest.fixture
def uncharted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(charts, "draw", lambda rows, success_m: {})


@pytest.fixture(scope="module")
def page() -> str:
    return report.page("my <plan>", ROWS, 2.0)


def cells(page: str, heading: str) -> list[list[str]]:
    """The words in the table below a heading."""
    table = page.split(f"<h2>{heading}</h2>")[1].split("</table>")[0]
    lines = table.split("<tr")[2:]
    return [[re.sub("<[^>]*>", "", cell) for cell in re.findall(r"<td.*?</td>", line)] for line in lines]


@pytest.mark.usefixtures("uncharted")
def test_runs_that_found_a_place_too_far_off_are_explained() -> None:
    rows = list(runs(0.5, 1.0, 5.0))
    assert (
        report.text(rows, 2.0).split("\n")[-1] == "1 of 3 runs that ended with found are no success: more than 2 m off"
    )
    assert "no success" not in report.text(rows[:2], 2.0)
    assert "1 of 3 runs that ended with found are no success: more than 2 m off." in report.page("x", rows, 2.0)


def test_the_page_has_every_strategy_with_its_success_and_interval(page: str) -> None:
    by_strategy = cells(page, "By strategy")
    assert [line[0] for line in by_strategy] == ["flux", "estimate"]
    for name, runs_, found, rate, interval, *_ in by_strategy:
        mine = [one for one in ROWS if one.strategy == name]
        good = sum(one.success(2.0) for one in mine)
        ci = scipy.stats.binomtest(good, len(mine)).proportion_ci(method="wilson")
        assert (runs_, found) == (str(len(mine)), str(good))
        assert rate == f"{100 * good / len(mine):.1f} %"
        assert interval == f"{100 * ci.low:.1f}–{100 * ci.high:.1f} %"


def test_the_page_has_a_table_for_each_axis_of_several_values(page: str) -> None:
    assert re.findall("<h2>(.*?)</h2>", page) == ["By strategy", "By take-off height, m", "How the runs ended"]
    assert [line[:2] for line in cells(page, "By take-off height, m")] == [
        ["1 flux", "6"],
        ["estimate", "6"],
        ["2 flux", "6"],
        ["estimate", "6"],
    ]


@pytest.mark.usefixtures("uncharted")
def test_a_screen_has_room_for_all_columns_and_a_phone_always_shows_the_strategy(browser: Any, tmp_path: Path) -> None:
    long = "4 random within 50 m at 0 to 2 m, pulsed, modern"
    more = {"time_s": 100.0, "path_m": 100.0, "sigma_m": 2.0, "relative_m": 1.5, "relative_sigma_m": 2.0}
    every = [replace(one, scenario=f"{one.take_off_m:g} {long}", **more) for one in ROWS]
    file = tmp_path / "report.html"
    file.write_text(report.page("p", every, 2.0), encoding="utf-8")
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    tab.goto(file.as_uri())
    tables = "[...document.querySelectorAll('.wide')]"
    assert tab.evaluate(f"{tables}.filter(a => a.scrollWidth > a.clientWidth).length") == 0
    tab.set_viewport_size({"width": 400, "height": 900})
    tab.evaluate(f"{tables}.forEach(a => a.scrollLeft = 400)")
    lefts = tab.evaluate("[...document.querySelectorAll('.name')].map(a => a.getBoundingClientRect().x)")
    assert min(lefts) > 0
    tab.close()


def test_the_page_says_how_runs_ended(page: str) -> None:
    for outcome, *counts in cells(page, "How the runs ended"):
        for strategy, count in zip(("flux", "estimate"), counts, strict=True):
            mine = [one for one in ROWS if (one.strategy, one.outcome) == (strategy, outcome)]
            assert int(count or 0) == len(mine)


def test_the_page_is_one_file_well_formed_and_the_same_each_time(page: str) -> None:
    assert "my &lt;plan&gt;" in page
    assert not re.findall(r'(?:src|href)=(?!"data:)', page)
    assert ElementTree.fromstring(page.partition("<!doctype html>")[2]).findtext("head/title") == "my <plan>"
    assert report.page("my <plan>", ROWS, 2.0) == page


def test_the_charts_are_drawn_and_success_by_distance_where_distances_are_many() -> None:
    with undrawn():
        few = charts.draw(ROWS, 2.0)
    assert [caption.split(",")[0].split(":")[0] for caption in few] == [
        "Success",
        "Time until the transmitter is found",
        "Error of the place reported",
        "Differences on the same trials",
    ]
    drawn = charts.draw([replace(one, distance_m=float(n)) for n, one in enumerate(ROWS)], 2.0)
    assert list(drawn)[:3] == list(few)[:3]
    assert "distance" in list(drawn)[3]
    for svg in drawn.values():
        assert ElementTree.fromstring(svg).tag.endswith("svg")


@pytest.mark.usefixtures("uncharted")
def test_texts_of_a_plan_and_of_trials_are_texts_on_the_page() -> None:
    rows = [replace(ONE, scenario=f"<b>{n}", noise=f'"{n}', outcome="<script>alert(1)</script>") for n in range(2)]
    page = report.page("&amp;<i>", rows, 2.0)
    assert "<script" not in page
    assert "<b>" not in page
    assert [line[0] for line in cells(page, "By scenario")] == ["&lt;b&gt;0 flux", "&lt;b&gt;1 flux"]
    assert "<h1>&amp;amp;&lt;i&gt;</h1>" in page


@pytest.mark.parametrize(
    "rows",
    [runs(0.0), runs(None, strategy="x" * 40), [replace(ONE, distance_m=None)], runs(0.0, scenario=r"$\frac$")],
)
def test_any_rows_make_a_page(rows: list[TrialRow]) -> None:
    assert report.page("p", rows, 2.0).count("<figure>") == 3


def test_strategies_have_colours_of_their_own() -> None:
    shades = charts.colours(["a", "b", "a", "c"])
    assert list(shades) == ["a", "b", "c"]
    assert len(set(shades.values())) == 3


def test_without_matplotlib_the_page_says_how_to_get_charts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    page = report.page("p", ROWS, 2.0)
    assert "pip install 'arva-hil[plots]'" in page
    assert "<figure>" not in page
    assert [line[0] for line in cells(page, "By strategy")] == ["flux", "estimate"]


def test_groups_are_in_the_order_of_their_first_rows() -> None:
    assert list(groups(ROWS, "take_off_m", "strategy")) == [
        (height, strategy) for height in (1.0, 2.0) for strategy in ("flux", "estimate")
    ]
