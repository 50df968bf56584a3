"""A real browser for the tests of the page: Debian's Chromium, driven by Playwright. One for all tests of a worker."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ARGUMENTS = ["--no-sandbox", "--disable-background-networking", "--disable-component-update", "--disable-gpu"]
# when the program has ended
GONE = re.compile(r"net::ERR_(CONNECTION_\w+|CONTENT_LENGTH_MISMATCH|EMPTY_RESPONSE|SOCKET_NOT_CONNECTED)")
WAIT_MS = 60_000


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """The browser; the test is skipped where there is none."""
    api = pytest.importorskip("playwright.sync_api", reason="Playwright for Python is not installed")
    if CHROMIUM is None:
        pytest.skip("there is no Chromium: apt-get install chromium")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


class Tab:
    """The tab, and what goes wrong in it: one for all tests, for a new one costs more than what a test does in it.

    `open` waits until something is shown. Nothing glides in it, unless it `moves`.
    """

    def __init__(self, browser: Any) -> None:
        from playwright.sync_api import expect

        self.errors: list[str] = []
        self.asked: list[str] = []
        self._opened: list[str] = []
        self.page = browser.contexts[0].pages[0] if browser.contexts else browser.new_context().new_page()
        self.page.set_viewport_size({"width": 1280, "height": 900})
        self.page.emulate_media(reduced_motion="reduce", color_scheme="light")
        self.page.set_default_timeout(WAIT_MS)
        self._heard: dict[str, Callable[[Any], None]] = {
            "console": self._hear,
            "pageerror": lambda error: self.errors.append(str(error)),
            "request": lambda request: self.asked.append(request.url),
        }
        for event, hear in self._heard.items():
            self.page.on(event, hear)
        self._expect = expect

    def open(self, url: str) -> None:
        self._opened.append("/".join(url.split("/")[:3]) + "/")
        self.page.goto(url)
        self._expect(self.page.locator("html")).to_have_attribute("data-ready", "true", timeout=WAIT_MS)

    def moves(self) -> None:
        self.page.emulate_media(reduced_motion="no-preference")

    def shows(self, selector: str, text: Any) -> None:
        """Wait until an element has a text."""
        self._expect(self.page.locator(selector)).to_have_text(text, timeout=WAIT_MS)

    def text(self, selector: str) -> str:
        return str(self.page.locator(selector).inner_text())

    def rows(self, selector: str) -> list[list[str]]:
        """The texts of a table's cells."""
        return [
            [str(cell) for cell in row.locator("td").all_inner_texts()] for row in self.page.locator(selector).all()
        ]

    def close(self) -> None:
        """There was no error in it, and it asked nobody else."""
        self.page.goto("about:blank")
        for event, hear in self._heard.items():
            self.page.remove_listener(event, hear)
        assert self.errors == [], self.errors
        assert [url for url in self.asked if not url.startswith((*self._opened, "data:"))] == []

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning") and not GONE.search(message.text):
            self.errors.append(message.text)
