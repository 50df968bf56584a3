"""Kinds by name: what is built in is there and has what it needs, and what has gone wrong with others is said."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from arva_hil.errors import KindError
from arva_hil.registry import FORMATS, RECEIVERS, STRATEGIES, Registry

FIX = "fix the error and try again"
REGISTRIES = [RECEIVERS, FORMATS, STRATEGIES]


def names(of: Registry) -> str:
    return of.group


def toys(**built_in: str) -> Registry:
    return Registry("toy", "arva_hil.toys", built_in, ("play",), references=True)


@pytest.mark.parametrize("registry", REGISTRIES, ids=names)
def test_everything_built_in_is_there_and_has_what_it_needs(registry: Registry) -> None:
    for name in registry:
        assert registry._unfit(registry[name]) == ""


def test_listing_what_there_is_imports_none_of_it() -> None:
    listing = "import sys; from arva_hil import registry; list(registry.FORMATS); 'flux' in registry.STRATEGIES; "
    heavy = "print([m for m in ('numpy', 'pymavlink', 'importlib.metadata') if m in sys.modules])"
    ran = subprocess.run(
        [sys.executable, "-c", listing + heavy], capture_output=True, text=True, check=True, timeout=60
    )
    assert ran.stdout == "[]\n"


def test_an_unknown_name_is_answered_with_the_nearest_and_all_there_are() -> None:
    with pytest.raises(KindError) as error:
        STRATEGIES["fluks"]
    assert (
        str(error.value)
        == "no strategy 'fluks': did you mean flux? there are flux, extremum, estimate, or MODULE:CLASS"
    )
    assert "fluks" not in STRATEGIES


@pytest.mark.parametrize(
    ("reference", "what"),
    [
        ("no_such_module:Toy", "there is no module no_such_module: install it, or run this where the file is"),
        ("mine:Nothing", "mine has no Nothing: write MODULE:CLASS"),
        ("mine:Tou", "did you mean Toy?"),
        ("mine:Broken", "'mine:Broken' lacks play: " + FIX),
        ("mine:Asked", "'mine:Asked' lacks play: " + FIX),
        ("raises:Toy", r"cannot be imported (RuntimeError: not today): " + FIX),
        ("needs:Toy", "cannot be imported (ModuleNotFoundError: No module named 'no_such_thing'): " + FIX),
        ("exits:Toy", "cannot be imported (SystemExit: 5)"),
        ("half written", "no toy 'half written'"),
        ("mine:", "is no name of a class: write MODULE:CLASS"),
        ("../mine:Toy", "is no name of a class"),
    ],
)
def test_a_reference_that_cannot_be_used_says_why(
    reference: str, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(
        "from typing import Protocol\n"
        "class Toy:\n    def play(self): ...\n"
        "class Broken: ...\n"
        "class Player(Protocol):\n    def play(self): ...\n"
        "class Asked(Player): ...\n"
    )
    Path("raises.py").write_text("raise RuntimeError('not today')\n")
    Path("needs.py").write_text("import no_such_thing\n")
    Path("exits.py").write_text("raise SystemExit(5)\n")
    try:
        assert toys()["mine:Toy"].__name__ == "Toy"
        with pytest.raises(KindError) as error:
            toys()[reference]
        assert what in str(error.value)
        assert "" not in sys.path[-1:]
    finally:
        for module in ("mine", "raises", "needs", "exits"):
            sys.modules.pop(module, None)
