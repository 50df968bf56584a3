"""What is built in is found by its name, wherever the program is started."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arva_hil.cli.main import main
from arva_hil.config import ScenarioError, load
from arva_hil.config.campaign import load_plan
from arva_hil.config.profiles import builtin_files
from tests.every import every

CONFIGS = Path(__file__).parents[2] / "configs"


def test_every_file_of_configs_has_a_name() -> None:
    files = {path.relative_to(CONFIGS).with_suffix("").as_posix(): path for path in CONFIGS.rglob("*.yaml")}
    assert builtin_files() == files
    assert len(files) > 10


def test_a_scenario_is_loaded_by_its_name_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load("builtin:four_transmitters") == load(CONFIGS / "four_transmitters.yaml")


def test_a_plan_finds_its_scenarios_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert list(load_plan("builtin:campaigns/paper").scenarios) == [f"paper_case_{n}" for n in (1, 2, 3, 4)]


@every(
    "name",
    ["builtin:", "builtin:four_transmiters", "builtin:../../etc/passwd", "builtin:/etc/passwd"],
)
def test_a_name_that_is_not_built_in_is_refused(name: str) -> None:
    with pytest.raises(ScenarioError, match="no such file is built in, expected one of alpine_lla") as error:
        load(name)
    assert error.value.problems[0].source == name


def test_the_nearest_name_is_offered() -> None:
    with pytest.raises(ScenarioError, match="did you mean 'four_transmitters'"):
        load("builtin:Four_transmiters.yaml")


def test_the_names_are_listed_with_what_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenarios", "--json"]) == 0
    listed = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [one["name"] for one in listed] == [f"builtin:{name}" for name in builtin_files()]
    assert all(one["about"].endswith(".") for one in listed)
    assert main(["check", *[one["name"] for one in listed]]) == 0
