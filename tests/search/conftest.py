"""The states of a flight and of the permission to arm change as their tables say, in every test of this folder."""

from __future__ import annotations

from typing import Any

import pytest

from arva_hil.autopilot.commanding.commander import PHASES, Commander
from arva_hil.search.flight.preflight import CONSENTS, Permission


@pytest.fixture(autouse=True)
def by_the_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    def watch(kind: type[Any], name: str, table: Any) -> None:
        def change(self: Any, attribute: str, value: Any) -> None:
            if attribute == name and (before := vars(self).get(name, value)) != value:
                assert value in table[before].then, f"{before} → {value}"
            object.__setattr__(self, attribute, value)

        monkeypatch.setattr(kind, "__setattr__", change)

    watch(Commander, "phase", PHASES)
    watch(Permission, "consent", CONSENTS)
