"""Pages are short: how-tos and lessons, all pages together, and their sentences."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from .pages import ROOT

HOW_TO = 700  # words of a page
RESULTS = 600  # words of the measurements
ALL = 25_000  # words of README, docs and firmware_proto
SENTENCE = 25  # words of the longest sentence
MEAN = 12.0  # words of a sentence, of a page

GUIDES = sorted([*(ROOT / "docs/howto").glob("*.md"), *(ROOT / "docs/tutorial").glob("*.md")])
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "firmware_proto").rglob("*.md")])


def words(path: Path) -> int:
    """Count words, of code and tables too; signs alone, like the bars of a table, are none."""
    return sum(bool(re.search(r"\w", word)) for word in path.read_text(encoding="utf-8").split())


def sentences(path: Path) -> list[str]:
    """Return the sentences of a page, and its list items; no code, tables, headings, sources or equations."""
    text = path.read_text(encoding="utf-8").split("\n## Sources")[0]
    text = re.sub(r"(?ms)^( *)```.*?^\1```$|^\$\$.*?^\$\$$|^ {4}.*?$|^\|.*?$|^#.*?$|^\w+ +\|.*?$", "", text)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"(?m)^> ?(\[!\w+\])?", "", text))
    parts = re.split(r"(?<=[.!?:;])[*)]*\s+|\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", text)
    return [" ".join(part.split()) for part in parts if part.strip()]


@pytest.mark.parametrize("page", GUIDES, ids=lambda page: page.stem)
def test_a_guide_is_short(page: Path) -> None:
    assert words(page) <= HOW_TO


def test_the_measurements_are_one_short_table() -> None:
    page = ROOT / "docs/measurements.md"
    assert words(page) <= RESULTS
    assert page.read_text(encoding="utf-8").count("\n|---") == 1


def test_all_pages_together_are_short() -> None:
    counted = {str(page.relative_to(ROOT)): words(page) for page in PAGES}
    assert sum(counted.values()) <= ALL, counted


def test_no_sentence_is_long() -> None:
    long = [
        (len(one.split()), page.name, one) for page in PAGES for one in sentences(page) if len(one.split()) > SENTENCE
    ]
    assert sorted(long, reverse=True) == []


def test_sentences_are_short_in_the_mean(record_property: pytest.RecordProperty) -> None:
    """The means are in the report of the tests, and in the message of a failure."""
    lengths = {page: [len(one.split()) for one in sentences(page)] for page in PAGES}
    means = {str(page.relative_to(ROOT)): sum(all_) / len(all_) for page, all_ in lengths.items() if all_}
    for page, mean in means.items():
        record_property(f"words a sentence: {page}", f"{mean:.1f}")
    assert {page: mean for page, mean in means.items() if mean > MEAN} == {}
