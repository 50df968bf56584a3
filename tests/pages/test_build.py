"""The pages build without a warning, their examples are right, every link leads somewhere, and nothing is fetched."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest

import arva_hil
from arva_hil.cli.main import COMMANDS
from tests.once import once

ROOT = Path(__file__).parents[2]
LACKING = [name for name in ("sphinx", "furo", "myst_parser", "latex2mathml") if find_spec(name) is None]

pytestmark = pytest.mark.skipif(bool(LACKING), reason=f"pip install 'arva-hil[docs]': no {', '.join(LACKING)}")


class Page(HTMLParser):
    """Links of a page, what a browser would load for it, its anchors, titles, boxes, and its text without code."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.titles = 0
        self.boxes = 0
        self.texts: list[str] = []
        self._code = 0
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = {name: value for name, value in attributes if value}
        self.anchors.add(values.get("id", ""))
        self.titles += tag == "h1"
        self.boxes += tag == "div" and values.get("class", "").startswith("admonition ")
        self._code += tag in ("pre", "code", "script")
        if tag == "a":
            self.links.append(values.get("href", "#"))
        elif tag == "link":
            self.loads.append(values.get("href", ""))
        if "src" in values:
            self.loads.append(values["src"])

    def handle_endtag(self, tag: str) -> None:
        self._code -= tag in ("pre", "code", "script")

    def handle_data(self, data: str) -> None:
        if not self._code:
            self.texts.append(data)


# Sphinx as `make docs` calls it: a process for both builders, of which one reads the pages. It collects no garbage, and
# makes no stems of words for the search and no list of all pages beside each page, for these are a quarter of its time
SPHINX = """
import gc, sys
import furo
from sphinx.cmd.build import build_main
from sphinx.search.en import SearchEnglish
gc.disable()
SearchEnglish.stem = lambda _, word: word
furo._compute_navigation_tree = lambda context: ""
options = ["-q", "-W", "--keep-going", "-n", "-d", "doctrees"]
codes = [build_main([*options, "-b", builder, sys.argv[1], builder]) for builder in ("html", "doctest")]
sys.exit(codes[0] + 2 * codes[1])
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the pages in `html` and the results of their examples in `doctest`, built once."""
    return once(tmp_path_factory, "pages", build)


@pytest.fixture(scope="module")
def pages(built: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in (built / "html").rglob("*.html")}


def build(folder: Path) -> None:
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", SPHINX, str(ROOT / "docs")],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout


def test_the_pages_build_without_a_warning_and_lead_where_they_say(built: Path, pages: dict[Path, Page]) -> None:
    html = built / "html"
    assert len(pages) > 25
    broken, remote = [], []
    for path, page in pages.items():
        remote += [(path.name, load) for load in page.loads if urlsplit(load).netloc]
        broken += [(path.name, link) for link in (*page.links, *page.loads) if not leads_somewhere(link, path, pages)]
    assert broken == []
    assert remote == [], "a browser would fetch this"
    commands = pages[html / "reference/commands.html"]
    assert {*COMMANDS} - commands.anchors == set()
    public = (html / "reference/python.html").read_text(encoding="utf-8")
    assert [name for name in arva_hil.__all__ if f'id="arva_hil.{name}"' not in public] == []
    assert " at 0x" not in public
    assert public.index('id="arva_hil.run_live"') < min(
        public.index(f'id="arva_hil.{name}"') for name in arva_hil.__all__ if name != "run_live"
    )
    assert "ARVA_HIL_STREAM_RATE" in (html / "reference/commands.html").read_text(encoding="utf-8")


UNREAD = re.compile(r":::|\{[a-z:]+\}|\[!\w+\]|^\s*>\s|\]\(|eval-rst|(?<!`)``(?!`)", re.MULTILINE)


def test_no_page_shows_markup_and_each_has_one_title(pages: dict[Path, Page]) -> None:
    pages = {path: page for path, page in pages.items() if path.stem != "search"}
    shown = [(path.name, text) for path, page in pages.items() for text in page.texts if UNREAD.search(text)]
    assert shown == []
    assert [path.name for path, page in pages.items() if page.titles != 1] == []


def test_warnings_are_boxes(built: Path, pages: dict[Path, Page]) -> None:
    sources = {path: path.read_text(encoding="utf-8").count("> [!") for path in (ROOT / "docs").rglob("*.md")}
    html = built / "html"
    boxes = {path: pages[html / path.relative_to(ROOT / "docs").with_suffix(".html")].boxes for path in sources}
    assert sum(sources.values()) >= 6
    assert {path.name: boxes[path] for path, count in sources.items() if boxes[path] < count} == {}


def test_the_tables_of_keys_fit_a_screen(built: Path, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    for name in ("scenario", "reference/commands", "howto/recordings", "reference/messages"):
        page.goto((built / f"html/{name}.html").as_uri())
        wide = page.evaluate(
            "[...document.querySelectorAll('.table-wrapper')].filter(a => a.scrollWidth > a.clientWidth + 1).length"
        )
        assert wide == 0, name
    page.close()


def leads_somewhere(link: str, path: Path, pages: dict[Path, Page]) -> bool:
    """Whether a link within the pages leads to a file and, on a page, to a place on it."""
    parts = urlsplit(link)
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if parts.scheme or target not in pages:
        return bool(parts.scheme) or target.exists()
    return not parts.fragment or parts.fragment in pages[target].anchors


def test_the_examples_in_the_pages_and_docstrings_are_right(built: Path) -> None:
    summary = (built / "doctest" / "output.txt").read_text(encoding="utf-8")
    assert re.search(r"^ *[1-9]\d* tests\n *0 failures in tests", summary, re.M)
