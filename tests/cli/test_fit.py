"""`arva-hil fit`: the profile, the table and the objects; what is wrong on the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from tests.every import every
from tools.real.profiles import drawn
from tools.real.rehearsal import rehearse

from ..records.test_fitting import SHORT
from .far_ends import Arva


def test_a_profile_a_scenario_and_a_table(arva: Arva, tmp_path: Path) -> None:
    chosen, truth = drawn(1)
    folder = rehearse(tmp_path / "r", replace(chosen, navigation_error=None), SHORT[:9], latency_s=truth["latency"])
    words = (folder, "--gps-sigma", 0.05, "--out", tmp_path / "p.yaml", "--scenario-out", tmp_path / "s.yaml")
    code, out, err = arva("fit", *words)
    assert code == 0, err
    assert "kappa_eq" in out
    assert "95 % interval" in out
    assert arva("check", tmp_path / "p.yaml", tmp_path / "s.yaml").code == 0
    code, out, _ = arva("compare", folder, "--scenario", tmp_path / "s.yaml", "--json")
    assert code == 0
    assert json.loads(out)["all"]["ratio"] - 1 < 0.02


@every(
    "arguments, what, cure",
    [
        ("fit r", "--out is missing", "--out my_receiver.yaml"),
        ("fit --out p.yaml", "RECORD", "--help"),
        ("fit r --model morse --out p.yaml", "morse", "pulsed"),
        ("fit nowhere --out p.yaml", "no such folder", "--record"),
    ],
)
def test_wrong_words_are_refused(arva: Arva, arguments: str, what: str, cure: str) -> None:
    code, _, err = arva(*arguments.split())
    assert code == 2
    assert what in err
    assert cure in err
