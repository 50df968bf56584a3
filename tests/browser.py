"""A real browser for the tests of the page: Debian's Chromium, driven by Playwright. One for all tests of a worker."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ARGUMENTS = ["--no-sandbox", "--disable-background-networking", "--disable-component-update", "--disable-gpu"]
GONE = re.compile(r"net::ERR_(CONNECTION_\w+|EMPTY_RESPONSE|SOCKET_NOT_CONNECTED)")  # when the program has ended
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
    """One tab, and what went wrong in it. `open` waits until something is shown."""

    def __init__(self, browser: Any, **context: Any) -> None:
        from playwright.sync_api import expect

        self.errors: list[str] = []
        self.asked: list[str] = []
        self._context = browser.new_context(viewport={"width": 1280, "height": 900}, **context)
        self.page = self._context.new_page()
        self.page.set_default_timeout(WAIT_MS)
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self._expect = expect

    def open(self, url: str) -> None:
        self.page.goto(url)
        self._expect(self.page.locator("html")).to_have_attribute("data-ready", "true", timeout=WAIT_MS)

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
        origin = "/".join(self.page.url.split("/")[:3]) + "/"
        self._context.close()
        assert self.errors == []
        assert [url for url in self.asked if not url.startswith((origin, "data:"))] == []

    def _hear(self, message: Any) -> None:
        if message.type in ("error", "warning") and not GONE.search(message.text):
            self.errors.append(message.text)
