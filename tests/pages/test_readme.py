"""README is for visitors: short, its links and pictures are there; CITATION.cff says what the package says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

import arva_hil
from tools.__main__ import PROGRAMS

from .pages import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
DOI = "10.1109/ICRA40945.2020.9196914"


def test_it_is_short() -> None:
    assert len(README.split()) < 900


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_what_it_links_to_is_there(page: str) -> None:
    targets = re.findall(r"\]\(([^)#]+)", (ROOT / page).read_text(encoding="utf-8"))
    assert targets
    assert [target for target in targets if not target.startswith("https:") and not (ROOT / target).exists()] == []


def test_an_environment_is_named_before_any_pip() -> None:
    assert README.index("-m venv") < README.index("pip install")


def test_the_safety_of_the_bench_comes_before_the_first_cable() -> None:
    safety = README.index("Propellers off")
    assert safety < README.index("3.3 V") < README.index("who has the sticks") < README.index("/dev/ttyUSB0", safety)


def test_the_citation_is_this_version_and_names_the_paper() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["version"] == arva_hil.__version__
    assert citation["license"] == "MIT"
    assert [paper["doi"] for paper in citation["references"]] == [DOI]
    assert DOI in README


def test_pictures_are_small() -> None:
    assert Path(ROOT / "docs/pictures/demo.gif").stat().st_size < 1_000_000
    assert [path for path in (ROOT / "docs/pictures").glob("*.png") if path.stat().st_size > 100_000] == []


def test_how_to_cite_has_this_version_and_the_paper() -> None:
    page = (ROOT / "docs/cite.md").read_text(encoding="utf-8")
    assert f"{{{arva_hil.__version__}}}" in page
    assert DOI in page


def test_the_list_of_tools_has_every_program() -> None:
    rows = re.findall(r"(?m)^\| (`.*?) \|", (ROOT / "tools/README.md").read_text(encoding="utf-8"))
    named = {name for row in rows[1:] for name in re.findall(r"`([a-z ]+)`", row)}
    assert named == set(PROGRAMS)
