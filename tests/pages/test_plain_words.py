"""Pages and messages have no vague word: `look`, `tell`, `way`, `nobody`. Docstrings begin as the style asks."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.bench import house

from .pages import ROOT

VAGUE = re.compile(
    r"(?<![\w./-])(hear|hears|heard|hearing|look|looks|looked|looking|show|shows|showed|shown|showing|tell|tells|told|"
    r"telling|believe|believes|believed|disbelieved|obey|obeys|obeyed|noted|word|way|ways|stray|strays|anew|at last|"
    r"by a hair|nobody|somebody|whoever|what it says)(?![\w/(=-])",
    re.I,
)
OPENERS = re.compile(r"(What|Whether|How|Who|Whose|Where|When|Which)\b")
ARTICLES = re.compile(r"(The|A|An|All|Each|Every|One|Those|Returns|Raises|Yields)\b")  # a function begins with a verb
PAGES = sorted(
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
    found = {str(page.relative_to(ROOT)): vague(prose(page)) for page in PAGES}
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
