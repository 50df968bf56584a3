"""`arva-hil campaign`: flown to its end, stopped in every way and gone on with, refused."""

from __future__ import annotations

import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from arva_hil.campaign import charts, runner, trial
from arva_hil.campaign.results import opened
from arva_hil.cli import campaign
from tests.campaign import fakes

from . import far_ends
from .far_ends import Arva, Start, until
from .test_terminal import Terminal

TESTS = Path(__file__).parent.parent
PLAN = fakes.PLAN.replace("estimate", "estimate, extremum")
TRIALS = 6 * 2 * 3


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return plan_file(tmp_path, monkeypatch, PLAN)


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The gate of `fakes.gated`: what programs started here fly by."""
    folder = tmp_path / "gate"
    folder.mkdir()
    monkeypatch.setenv(fakes.FOLDER, str(folder))
    monkeypatch.setattr(far_ends, "PROGRAM", [sys.executable, str(TESTS / "campaign" / "driver.py"), "gated"])
    return folder


def plan_file(folder: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> Path:
    """A plan's file. In this process the flights are fakes, one at a time in a thread, and a report has no charts."""
    monkeypatch.setattr(trial, "fly", fakes.fake)
    monkeypatch.setattr(campaign, "processes", fakes.here)
    monkeypatch.setattr(charts, "draw", lambda rows, success_m: {})
    monkeypatch.setenv("ARVA_HIL_JOBS", "1")
    path = folder / "plan.yaml"
    path.write_text(text)
    return path


def flights(gate: Path) -> list[tuple[int, str]]:
    """(process, trial) of every flight begun."""
    file = gate / "flown"
    lines = file.read_text().splitlines() if file.exists() else []
    return [(int(line.split(" ", 1)[0]), line.split(" ", 1)[1]) for line in lines]


def rows(out: Path) -> int:
    """How many there are in the database, looked at past its lock: -1 when that is at a wrong moment."""
    journal = out / "results.sqlite-journal"
    try:
        with closing(sqlite3.connect(f"file:{out / 'results.sqlite'}?immutable=1", uri=True)) as database:
            count = int(database.execute("SELECT count(*) FROM results").fetchone()[0])
        written = not journal.exists() or not journal.read_bytes()[:8].strip(b"\0")  # else the last may be taken back
        return count if written else -1
    except (sqlite3.DatabaseError, FileNotFoundError):
        return -1


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2][0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_it_flies_the_plan_and_reports(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(plan.parent)
    code, out, err = arva("campaign", plan)
    assert code == 0
    first = [line.split()[0] for line in out.splitlines()]
    assert first == ["strategy", "flux", "estimate", "extremum", "success:", "2"]
    assert f"{TRIALS} trials, 0 of them done; processes: 1" in err
    assert "plan-results/results.csv, plan-results/report.html" in err
    assert rows(Path("plan-results")) == TRIALS
    page = Path("plan-results/report.html").read_text()
    assert all(name in page for name in ("flux", "estimate", "extremum"))


def test_the_names_of_a_plan_and_its_scenarios_are_text_on_the_page_and_on_the_terminal(arva: Arva, plan: Path) -> None:
    names = [os.fsdecode(b'<img src=x onerror="alert(1)">\x1b[2J\xff.yaml'), "=1+1<b>.yaml"]
    named, scenario = (plan.parent / name for name in names)
    scenario.write_text("transmitters: [{id: 1, ned: [5, 5, 0]}]\n")
    named.write_text(f"strategies: flux\nscenarios: '{scenario.name}'\nseeds: 2\n")
    code, out, err = arva("campaign", named, "--out", plan.parent / "r")
    assert code == 0
    page = (plan.parent / "r" / "report.html").read_text()
    assert "<img src=x" not in page
    assert "<b>" not in page
    assert "&lt;img src=x onerror=" in page
    assert "\x1b" not in page + out + err
    assert "'=1+1<b>" in (plan.parent / "r" / "results.csv").read_text()


def test_results_are_the_same_bytes_whatever_the_number_of_processes(
    arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = [plan.parent / "none", plan.parent / "two"]
    assert arva("campaign", plan, "--out", folders[0]).code == 0
    monkeypatch.setattr(campaign, "processes", runner.processes)
    assert arva("campaign", plan, "--jobs", 2, "--out", folders[1]).code == 0
    for name in ("results.csv", "report.html"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_a_finished_campaign_is_not_flown_again_and_a_larger_one_goes_on(arva: Arva, plan: Path) -> None:
    _, out, _ = arva("campaign", plan, "--json", "--out", plan.parent / "r")
    objects = [json.loads(line) for line in out.splitlines()]
    assert len({one["key"] for one in objects}) == len(objects) == TRIALS
    assert objects[0].items() >= {"strategy": "flux", "seed": 1, "take_off_m": 1.0, "noise": "uniform"}.items()
    before = (plan.parent / "r" / "results.csv").read_bytes()
    code, out, err = arva("campaign", plan, "--json", "--out", plan.parent / "r")
    assert (code, out) == (0, "")
    assert (plan.parent / "r" / "results.csv").read_bytes() == before
    plan.write_text(PLAN.replace("seeds: 6", "seeds: 8"))
    code, out, err = arva("campaign", plan, "--json", "--out", plan.parent / "r")
    assert (code, out.count("\n")) == (0, 2 * 2 * 3)
    assert f"{TRIALS + 12} trials, {TRIALS} of them done" in err
    assert (plan.parent / "r" / "results.csv").read_bytes().startswith(before)


def test_a_dry_run_lists_the_trials_as_they_would_be_flown_and_touches_nothing(arva: Arva, plan: Path) -> None:
    before = sorted(plan.parent.iterdir())
    code, out, err = arva("campaign", plan, "--dry-run", "--out", plan.parent / "r")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert len(lines) == TRIALS
    assert lines[0] == (
        "flux: random within 50 m at 0 to 2 m, seed 1, noise uniform, wind 0 m/s, GPS noise 0 m, "
        "take-off 1 m, height 3 m, 1 m/s, 900 s"
    )
    _, listed, _ = arva("campaign", plan, "--dry-run", "--json", "--out", plan.parent / "r")
    assert sorted(plan.parent.iterdir()) == before
    _, flown, _ = arva("campaign", plan, "--json", "--out", plan.parent / "r")
    for one, other in zip(listed.splitlines(), flown.splitlines(), strict=True):
        assert json.loads(one).items() <= json.loads(other).items()


def test_trials_that_fail_are_counted_and_flown_again(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ("campaign", plan, "--json", "--out", plan.parent / "r")
    monkeypatch.setattr(trial, "fly", fakes.raising)
    code, out, err = arva(*command)
    assert (code, out.count("\n")) == (1, TRIALS)
    assert f"18 of {TRIALS} trials failed; the first one: failed: ZeroDivisionError: by nothing" in err
    assert "failed: ZeroDivisionError: by nothing" in (plan.parent / "r" / "report.html").read_text()
    monkeypatch.setattr(trial, "fly", fakes.fake)
    code, out, err = arva(*command)
    assert (code, out.count("\n")) == (0, 18)
    assert rows(plan.parent / "r") == TRIALS
    assert b"failed" not in (plan.parent / "r" / "results.csv").read_bytes()


def test_a_worker_that_dies_is_said_and_what_is_done_stays(
    arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "fly", fakes.dying)
    monkeypatch.setattr(campaign, "processes", runner.processes)
    out = plan.parent / "r"
    code, _, err = arva("campaign", plan, "--out", out)
    assert code == 1
    assert f"a worker process died, killed or out of memory; 18 of {TRIALS} results are in {out}/results.sqlite" in err
    assert "the same command continues it" in err
    assert rows(out) == 18


def test_killed_it_loses_nothing_and_repeats_only_what_was_in_the_air(
    start: Start, arva: Arva, plan: Path, gate: Path
) -> None:
    command = ("campaign", plan, "--jobs", 2, "--out", plan.parent / "r")
    program = start(*command)
    until(lambda: len(flights(gate)) == 20 and rows(plan.parent / "r") == 18)
    program.process.kill()
    assert program.ends() == -signal.SIGKILL
    until(lambda: not any(alive(process) for process, _ in flights(gate)))
    assert rows(plan.parent / "r") == 18
    (gate / "open").touch()
    program = start(*command)
    assert program.ends() == 0
    assert f"{TRIALS} trials, 18 of them done" in program.err
    flown = [what for _, what in flights(gate)]
    assert len(set(flown)) == TRIALS
    assert len(flown) == TRIALS + 2
    twice = {what for what in flown if flown.count(what) == 2}
    assert {int(what.split()[1]) for what in twice} == {fakes.FREE + 1}  # what waited at the gate
    assert arva("campaign", plan, "--out", plan.parent / "unbroken").code == 0
    assert (plan.parent / "unbroken" / "results.csv").read_bytes() == (plan.parent / "r" / "results.csv").read_bytes()


@pytest.mark.parametrize(("number", "whom", "jobs"), [(signal.SIGINT, "group", 2), (signal.SIGTERM, "program", 1)])
def test_interrupted_it_ends_with_its_workers_and_says_how_to_go_on(
    start: Start, plan: Path, gate: Path, number: signal.Signals, whom: str, jobs: int
) -> None:
    out = plan.parent / "r"
    program = start("campaign", plan, "--jobs", jobs, "--out", out, start_new_session=True)
    until(lambda: len(flights(gate)) == 18 + jobs and rows(out) == 18)
    if whom == "group":  # as a terminal does
        os.killpg(program.process.pid, number)
    else:
        program.send(number)
    assert program.ends() == 130
    assert not any(alive(process) for process, _ in flights(gate))
    assert (
        f"interrupted: 18 of {TRIALS} results are in {out}/results.sqlite; the same command continues it" in program.err
    )
    assert "died" not in program.err
    assert rows(out) == 18


def test_interrupted_while_its_workers_start_it_is_quiet_too(start: Start, plan: Path, gate: Path) -> None:
    program = start("campaign", plan, "--jobs", 2, "--out", plan.parent / "r", start_new_session=True)
    program.says("0 of them done")
    os.killpg(program.process.pid, signal.SIGINT)
    assert program.ends() == 130
    assert "interrupted" in program.err


def test_two_campaigns_do_not_write_one_file(arva: Arva, plan: Path) -> None:
    out = plan.parent / "r"
    with opened(out):
        code, _, err = arva("campaign", plan, "--out", out)
    assert code == 2
    assert f"{out / 'results.sqlite'}: another campaign or another program is at work there" in err


def test_a_terminal_has_a_bar_and_when_it_is_closed_results_are_whole(
    start: Start, plan: Path, gate: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TQDM_ASCII", " #")  # or a character of the bar may be read in halves
    out = plan.parent / "r"
    terminal = Terminal(120)
    program = start("campaign", plan, "--out", out, stderr=terminal.slave)
    terminal.shows(r"50 % \|.*\| 18 of 36 trials, .* left")
    terminal.close()
    program.send(signal.SIGHUP)
    assert program.ends() == 130
    assert not any(alive(process) for process, _ in flights(gate))
    assert rows(out) == 18


def test_a_reader_that_goes_ends_it_and_its_results_are_whole(start: Start, plan: Path, gate: Path) -> None:
    out = plan.parent / "r"
    program = start("campaign", plan, "--out", out, "--json", stdout=subprocess.PIPE)
    assert program.process.stdout is not None
    program.process.stdout.readline()
    program.process.stdout.close()
    (gate / "open").touch()
    assert program.ends() == 141
    assert "stdout" not in program.err
    assert 1 <= rows(out) < TRIALS


def test_a_pipe_has_a_line_now_and_then(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "_PLAIN_S", 0.0)
    _, _, err = arva("campaign", plan, "--out", plan.parent / "r")
    counts = [int(line.split()[0]) for line in err.splitlines() if f" of {TRIALS} trials" in line]
    assert len(counts) > 1
    assert counts == sorted(counts)


@pytest.mark.parametrize("name", ["results.csv", "report.html"])
def test_what_is_not_its_own_is_not_written_over(arva: Arva, plan: Path, name: str) -> None:
    (plan.parent / name).write_text("mine\n")
    code, _, err = arva("campaign", plan, "--out", plan.parent)
    assert code == 2
    assert f"{plan.parent / name}: not from a campaign" in err
    assert (plan.parent / name).read_text() == "mine\n"


@pytest.mark.parametrize("name", ["results.sqlite", "results.csv", "report.html"])
def test_nothing_is_written_through_a_symlink(arva: Arva, plan: Path, name: str) -> None:
    folder, target = plan.parent / "out", plan.parent / "of somebody"
    assert arva("campaign", plan, "--out", folder).code == 0
    (folder / name).rename(target)
    kept = target.read_bytes()
    (folder / name).symlink_to(target)
    code, _, err = arva("campaign", plan, "--out", folder)
    assert code == 2
    assert str(folder / name) in err
    assert (folder / name).is_symlink()
    assert target.read_bytes() == kept


def test_its_folder_may_be_a_symlink(arva: Arva, plan: Path) -> None:
    (plan.parent / "disk").mkdir()
    (plan.parent / "out").symlink_to(plan.parent / "disk")
    assert arva("campaign", plan, "--out", plan.parent / "out").code == 0
    assert (plan.parent / "disk" / "results.csv").is_file()


def test_every_mistake_in_a_plan_and_its_scenarios_is_shown(arva: Arva, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("transmitters: []\n")
    plan = tmp_path / "plan.yaml"
    plan.write_text("strategies: flx\nscenarios: a.yaml\nsedes: 5\n")
    code, out, err = arva("campaign", plan)
    assert (code, out) == (2, "")
    assert f"{plan}:1:13: strategies: 'flx', expected one of flux" in err
    assert f"{plan}:3:1: unknown key 'sedes'" in err
    assert f"{tmp_path / 'a.yaml'}:1:15: " in err
    assert "did you mean 'flux'?" in err


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ("", "required: PLAN.yaml"),
        ("none.yaml", "none.yaml:1:1: No such file or directory, expected the plan of a campaign"),
        ("p.yaml --jobs 0", "--jobs: '0': expected a whole number 1…1024"),
        ("p.yaml --scheduler 10.0.0.1:8786", "--scheduler: '10.0.0.1:8786': expected an address such as tcp://"),
    ],
)
def test_wrong_arguments_are_refused(arva: Arva, arguments: str, what: str) -> None:
    code, out, err = arva("campaign", *arguments.split())
    assert (code, out) == (2, "")
    assert what in err


# A cluster


def test_on_a_cluster_results_are_the_same_bytes(arva: Arva, plan: Path) -> None:
    """Its workers are in this process; those of test_campaign_shards.py are processes."""
    from distributed import LocalCluster

    folders = [plan.parent / "local", plan.parent / "cluster"]
    assert arva("campaign", plan, "--out", folders[0]).code == 0
    with LocalCluster(
        n_workers=2, processes=False, threads_per_worker=1, host="tcp://127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as c:
        code, _, err = arva("campaign", plan, "--out", folders[1], "--scheduler", c.scheduler_address)
    assert code == 0
    assert "Dask workers: 2" in err
    assert (folders[0] / "results.csv").read_bytes() == (folders[1] / "results.csv").read_bytes()


def test_a_scheduler_that_is_not_there_is_no_link(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "_CONNECT_S", 0.3)
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{s.getsockname()[1]}"
        code, _, err = arva("campaign", plan, "--scheduler", address, "--out", plan.parent / "r")
    assert code == 3
    assert f"no Dask scheduler answers at {address}" in err
    assert "continues it once there is a scheduler" in err


def test_without_dask_it_is_said_how_to_get_it(arva: Arva, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    code, _, err = arva("campaign", plan, "--scheduler", "tcp://127.0.0.1:1", "--out", plan.parent / "r")
    assert code == 2
    assert "pip install 'arva-hil[dask]'" in err
    assert not (plan.parent / "r").exists()
