"""The page of a command: what it shows at the start, where it is, and what is said of it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Final

from arva_hil.config import Scenario
from arva_hil.observers.web.address import DEFAULT_HOST, HostPort
from arva_hil.observers.web.page import WebPage
from arva_hil.observers.web.state import State

_LOCAL: Final = ("127.", "localhost", "::1")
_POSE: Final = ("GLOBAL_POSITION_INT", "ATTITUDE")


def page_of_run(
    kind: str, options: argparse.Namespace, chosen: Scenario, say: Callable[[str], None], *, named: bool
) -> WebPage | None:
    """The page of a run with a scenario, None if none is wanted. Raises WebError if it cannot be served.

    `say` is told its address. `named`: there are several receivers.
    """
    rate_hz = getattr(options, "stream_rate", None)
    datum = chosen.datum if not isinstance(chosen.datum, str) else None

    def state() -> State:
        return State(
            kind,
            Path(chosen.source).name,
            datum=(datum.lat, datum.lon, datum.alt) if datum else None,
            kappa_eq=chosen.receiver.kappa_eq,
            asked_hz=dict.fromkeys(_POSE, rate_hz) if rate_hz else None,
            faults=[str(fault) for fault in chosen.faults],
            named=named,
        )

    return open_page(options.web, state, say)


def open_page(wanted: HostPort | str | None, state: Callable[[], State], say: Callable[[str], None]) -> WebPage | None:
    """The page at an address, None for none and "off". Raises WebError if it cannot be served. `say`: see above."""
    if not isinstance(wanted, HostPort):
        return None
    page = WebPage(wanted, state())
    for line in said_of(page.address, wanted):
        say(line)
    return page


def said_of(address: HostPort, wanted: HostPort) -> list[str]:
    """What there is to say of a page: its address, and who can see it."""
    taken = f" (port {wanted.port} is taken)" if wanted.port not in (0, address.port) else ""
    lines = [f"page: {address.url}{taken}"]
    if not address.host.startswith(_LOCAL):
        lines.append(f"warning: everybody in this network can see the page; --web {DEFAULT_HOST} shows it here only")
    return lines
