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


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where Sphinx keeps the pages as it has read them: to read them takes longest, and one builder reads for both."""
    return tmp_path_factory.mktemp("doctrees")


def build(builder: str, folder: Path, read: Path) -> subprocess.CompletedProcess[str]:
    """Sphinx, as `make docs` calls it."""
    options = ["-q", "-W", "--keep-going", "-n", "-d", str(read), "-b", builder, str(ROOT / "docs"), str(folder)]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run([sys.executable, "-m", "sphinx", *options], env=environment, capture_output=True, text=True)


def test_the_pages_build_without_a_warning_and_lead_where_they_say(tmp_path: Path, read: Path) -> None:
    """One test, for the pages are built once."""
    done = build("html", tmp_path, read)
    assert (done.returncode, done.stderr) == (0, "")
    pages = {path: Page(path) for path in tmp_path.rglob("*.html")}
    assert len(pages) > 25
    broken, remote = [], []
    for path, page in pages.items():
        remote += [(path.name, load) for load in page.loads if urlsplit(load).netloc]
        broken += [(path.name, link) for link in (*page.links, *page.loads) if not leads_somewhere(link, path, pages)]
    assert broken == []
    assert remote == [], "a browser would fetch this"
    commands = pages[tmp_path / "reference/commands.html"]
    assert {*COMMANDS} - commands.anchors == set()
    public = (tmp_path / "reference/python.html").read_text(encoding="utf-8")
    assert [name for name in arva_hil.__all__ if f'id="arva_hil.{name}"' not in public] == []
    assert " at 0x" not in public
    assert "ARVA_HIL_STREAM_RATE" in (tmp_path / "reference/commands.html").read_text(encoding="utf-8")


def leads_somewhere(link: str, path: Path, pages: dict[Path, Page]) -> bool:
    """Whether a link within the pages leads to a file and, on a page, to a place on it."""
    parts = urlsplit(link)
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if parts.scheme or target not in pages:
        return bool(parts.scheme) or target.exists()
    return not parts.fragment or parts.fragment in pages[target].anchors


def test_the_examples_in_the_pages_and_docstrings_are_right(tmp_path: Path, read: Path) -> None:
    done = build("doctest", tmp_path, read)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = (tmp_path / "output.txt").read_text(encoding="utf-8")
    assert re.search(r"^ *[1-9]\d* tests\n *0 failures in tests", summary, re.M)
