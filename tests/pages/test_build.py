"""The pages build without a warning, their examples are right, every link leads somewhere, and nothing is fetched."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import arva_hil
from arva_hil.cli.main import COMMANDS

ROOT = Path(__file__).parents[2]
LACKING = [name for name in ("sphinx", "furo", "myst_parser", "latex2mathml") if find_spec(name) is None]

pytestmark = pytest.mark.skipif(bool(LACKING), reason=f"pip install 'arva-hil[docs]': no {', '.join(LACKING)}")


class Page(HTMLParser):
    """Remembers what a page links to, what a browser would load for it, and its anchors."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = {name: value for name, value in attributes if value}
        self.anchors.add(values.get("id", ""))
        if tag == "a":
            self.links.append(values.get("href", "#"))
        elif tag == "link":
            self.loads.append(values.get("href", ""))
        if "src" in values:
            self.loads.append(values["src"])


# Sphinx as `make docs` calls it: a process for both builders, of which one reads the pages; it collects no garbage, for
# that is a third of its time
SPHINX = """
import gc, sys
from sphinx.cmd.build import build_main
gc.disable()
options = ["-q", "-W", "--keep-going", "-n", "-d", "doctrees"]
codes = [build_main([*options, "-b", builder, sys.argv[1], builder]) for builder in ("html", "doctest")]
sys.exit(codes[0] + 2 * codes[1])
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the pages in `html` and what became of their examples in `doctest`: built without a warning."""
    folder = tmp_path_factory.mktemp("pages")
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", SPHINX, str(ROOT / "docs")],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    return folder


def test_the_pages_build_without_a_warning_and_lead_where_they_say(built: Path) -> None:
    html = built / "html"
    pages = {path: Page(path) for path in html.rglob("*.html")}
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
    assert "ARVA_HIL_STREAM_RATE" in (html / "reference/commands.html").read_text(encoding="utf-8")


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
