"""Pages are short and plain, and so are messages and docstrings."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.bench import house

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


# -- pages and messages have no vague word: `look`, `tell`, `way`, `nobody`. Docstrings begin as the style asks --


VAGUE = re.compile(
    r"(?<![\w./-])(hear|hears|heard|hearing|look|looks|looked|looking|show|shows|showed|shown|showing|tell|tells|told|"
    r"telling|believe|believes|believed|disbelieved|obey|obeys|obeyed|noted|word|way|ways|stray|strays|anew|at last|"
    r"by a hair|nobody|somebody|whoever|what it says)(?![\w/(=-])",
    re.I,
)
OPENERS = re.compile(r"(What|Whether|How|Who|Whose|Where|When|Which)\b")
ARTICLES = re.compile(r"(The|A|An|All|Each|Every|One|Those|Returns|Raises|Yields)\b")  # a function begins with a verb
ALL_PAGES = sorted(
    [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "firmware_proto").rglob("*.md"),
    ]
)


def vague(text: str) -> list[str]:
    """Return the vague words of a text, without those in code."""
    return [str(match[0]) for match in VAGUE.finditer(re.sub(r"`[^`]*`|\{\w*:?", "", text))]


def prose(page: Path) -> str:
    """Return a page without blocks of code, sources and targets of links."""
    text = page.read_text(encoding="utf-8").split("\n## Sources")[0]
    return re.sub(r"(?ms)^( *)```.*?^\1```$|\]\([^)]*\)|^ {4}.*?$", "", text)


def messages(tree: ast.Module) -> Iterator[str]:
    """Yield the texts of a module that may become a message: those of several words that are no docstring."""
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str) or id(node) in alone:
            continue
        if len(node.value.split()) > 1 and not re.fullmatch(r"([A-Z]\w+ ?)+|\w+ or \w+", node.value):
            yield node.value


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("Nobody tells it.", ["Nobody", "tells"]),
        ("`look` is a method, on-the-way a name", []),
        ("{heard:no_vehicle}", []),
        ("a one-way link", []),
    ],
)
def test_vague_words_are_found_outside_of_code(text: str, found: list[str]) -> None:
    assert vague(text) == found


def test_no_page_has_a_vague_word() -> None:
    found = {str(page.relative_to(ROOT)): vague(prose(page)) for page in ALL_PAGES}
    assert {page: words for page, words in found.items() if words} == {}


def test_no_message_has_a_vague_word() -> None:
    found = [
        (module, text) for module, tree in house.modules("arva_hil").items() for text in messages(tree) if vague(text)
    ]
    assert found == []


def test_docstrings_begin_with_a_noun_phrase_or_with_a_verb() -> None:
    found = []
    for module, tree in (house.modules("arva_hil") | house.modules("firmware_proto")).items():
        for node in ast.walk(tree):
            if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            first = (ast.get_docstring(node) or "").split("\n")[0]
            property_ = isinstance(node, ast.FunctionDef) and any(
                "property" in ast.unparse(one) for one in node.decorator_list
            )
            verb = isinstance(node, ast.FunctionDef) and not property_ and module.startswith("arva_hil")
            if OPENERS.match(first) or (verb and ARTICLES.match(first)):
                found.append((module, first))
    assert found == []
