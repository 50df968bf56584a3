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


def build(builder: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Sphinx, as `make docs` calls it."""
    options = ["-q", "-W", "--keep-going", "-n", "-b", builder, str(ROOT / "docs"), str(folder)]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run([sys.executable, "-m", "sphinx", *options], env=environment, capture_output=True, text=True)


@pytest.fixture(scope="module")
def html(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("html")
    done = build("html", folder)
    assert (done.returncode, done.stderr) == (0, "")
    return folder


@pytest.mark.timeout(300)
def test_every_link_within_the_pages_leads_to_a_page_and_a_place_on_it(html: Path) -> None:
    pages = {path: Page(path) for path in html.rglob("*.html")}
    assert len(pages) > 25
    broken = []
    for path, page in pages.items():
        for link in (*page.links, *page.loads):
            parts = urlsplit(link)
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if parts.scheme:
                continue
            anchors = pages[target].anchors if target in pages else {parts.fragment}
            if not target.exists() or (parts.fragment and parts.fragment not in anchors):
                broken.append(f"{path.relative_to(html)}: {link}")
    assert broken == []


@pytest.mark.timeout(300)
def test_a_browser_loads_nothing_from_elsewhere(html: Path) -> None:
    pages = {path: Page(path) for path in html.rglob("*.html")}
    assert [(path.name, load) for path, page in pages.items() for load in page.loads if urlsplit(load).netloc] == []


@pytest.mark.timeout(300)
def test_every_command_and_every_option_is_in_the_reference(html: Path) -> None:
    from arva_hil.cli.main import COMMANDS

    page = (html / "reference/commands.html").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f'id="{name}"' not in page] == []
    assert "ARVA_HIL_STREAM_RATE" in page


@pytest.mark.timeout(300)
def test_the_examples_in_the_pages_and_docstrings_are_right(tmp_path: Path) -> None:
    done = build("doctest", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = (tmp_path / "output.txt").read_text(encoding="utf-8")
    assert re.search(r"^ *[1-9]\d* tests\n *0 failures in tests", summary, re.M)
