"""The page on a real receiver: the emulator stands in for it over pseudo-terminals; then a flight, its fit, a check."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from tools.real.profiles import drawn
from tools.real.rehearsal import rehearse

from ..records.test_fitting import SHORT
from .far_ends import Arva, Start


def test_the_emulator_is_recorded_as_if_it_were_a_receiver(arva: Arva, start: Start, tmp_path: Path) -> None:
    one, two, receiver = tmp_path / "vehicle-1", tmp_path / "vehicle-2", tmp_path / "receiver"
    start("vehicle", "--link", f"pty:{one}", "--link", f"pty:{two}").says("on the ground")
    start("--autopilot", one, "--port", f"pty:{receiver}").says("readings are real")
    words = ("--autopilot", two, "--receiver", receiver, "--duration", 14)
    code, _, err = arva("record", *words, tmp_path / "r")
    assert code == 0, err
    code, out, _ = arva("compare", tmp_path / "r", "--scenario", "builtin:default", "--json")
    assert code == 0
    said = json.loads(out)
    assert said["both"] >= 5
    assert abs(said["all"]["ratio"] - 1) < 0.05


def test_a_fit_of_one_flight_agrees_with_a_second_one(arva: Arva, tmp_path: Path) -> None:
    chosen, truth = drawn(7)
    chosen = replace(chosen, navigation_error=None)
    first = rehearse(tmp_path / "first", chosen, SHORT[:9], latency_s=truth["latency"])
    second = rehearse(tmp_path / "second", replace(chosen, seed=9), SHORT[4:13], latency_s=truth["latency"])
    site = tmp_path / "my_site.yaml"
    words = ("--out", tmp_path / "my_receiver.yaml", "--scenario-out", site, "--gps-sigma", 0.05)
    code, out, err = arva("fit", first, "--model", "paper", *words)
    assert code == 0, err
    assert "kappa_eq" in out
    assert "95 % interval" in out
    assert arva("check", tmp_path / "my_receiver.yaml", site).code == 0
    code, out, _ = arva("compare", second, "--scenario", site, "--json")
    assert code == 0
    said = json.loads(out)
    assert abs(said["all"]["ratio"] - 1) < 0.01
    assert abs(said["all"]["d_bias_m"]) < said["all"]["d_scatter_m"]
