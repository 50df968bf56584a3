"""`conform`: our decoders pass, mistakes are named, and no decoder can hold it up."""

from __future__ import annotations

import os
import select
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import pytest

from arva_hil.bench.clauses import clauses
from arva_hil.bench.judge import judge
from arva_hil.cli.main import main
from tests.every import every
from tests.once import once
from tools.fuzz import mutants

ROOT = Path(__file__).parents[2]
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def conform(capfd: pytest.CaptureFixture[str]) -> Run:
    def run(*arguments: str) -> tuple[int, str, str]:
        return main(["conform", *arguments]), *capfd.readouterr()

    return run


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    return [str(once(tmp_path_factory, "decoder-in-c", lambda folder: mutants.command(None, "c", folder)) / "decoder")]


def test_every_clause_names_a_section_of_the_protocol() -> None:
    text = (ROOT / "firmware_proto" / "PROTOCOL.md").read_text(encoding="utf-8")
    headings = {line.lstrip("# ") for line in text.splitlines() if line.startswith("#")}
    every_clause = list(clauses())
    assert {clause.section for clause in every_clause} <= headings
    assert len({clause.name for clause in every_clause}) == len(every_clause) == 30


def test_no_read_cuts_a_frame_of_the_burst_so_that_a_slow_decoder_passes() -> None:
    ((burst,),) = (clause.steps for clause in clauses() if clause.name == "burst")
    assert burst.data[::64] + burst.data[1::64] == b"\xa4" * 1800 + b"\x57" * 1800


def test_the_c_decoder_passes_every_clause(conform: Run, in_c: list[str], tmp_path: Path) -> None:
    report = tmp_path / "report.xml"
    code, out, err = conform("--timeout", "60", "--pty", "--junit", str(report), "--", *in_c)
    assert (code, err) == (0, f"written: {report}\n"), out
    assert out.splitlines()[-1] == "30 of 30 clauses hold"
    assert ElementTree.parse(report).getroot().attrib["tests"] == "30"


@every("language", ["python", "lua"])
def test_the_other_decoders_pass(conform: Run, tmp_path: Path, language: str) -> None:
    code, out, _ = conform(
        "--timeout", "60", "--only", "no-signal", "--", *mutants.command(None, language, tmp_path / language)
    )
    assert code == 0, out


def test_there_are_63_mistakes_and_each_is_at_one_place(tmp_path: Path) -> None:
    """`python -m tools fuzz mutants` builds and judges all of them."""
    assert len({one.name for one in mutants.MUTANTS}) == 63
    names = {clause.name for clause in clauses()}
    for one in mutants.MUTANTS:
        assert (ROOT / "firmware_proto" / one.file).read_text(encoding="utf-8").count(one.old) == 1, one.name
        assert one.clause in names


@every("name", ["c-drops-head", "c-short-pause", "c-synthetic-only", "python-delta-sign"])
def test_a_mistake_is_found_by_the_clause_that_names_it(name: str) -> None:
    (mutant,) = (one for one in mutants.MUTANTS if one.name == name)
    assert mutants.verdict(mutant).why


@every(
    "script, why",
    [
        ("exit 3", "it ended with exit code 3"),
        ("kill -9 $$", "it was killed by signal 9"),
        ("cat >/dev/null; sleep 60", "it does not end"),
        ("cat >/dev/null", "line 1 is missing"),
        ("yes", "it prints too much: more than"),
        ("cat >/dev/null; echo hello", "line 1: no JSON: 'hello'"),
        ("cat >/dev/null; echo '{}'", "line 1: no key 'seq'"),
        ("cat >/dev/null; echo '[1]'", "line 1: no JSON object"),
        ("cat >/dev/null; head -c 50000 /dev/zero | tr '\\0' '['; echo", "line 1: no JSON: '[[["),
    ],
)
def test_a_decoder_that_misbehaves_fails_the_clause_and_the_rest_goes_on(script: str, why: str) -> None:
    (clause,) = (one for one in clauses() if one.name == "whole")
    assert why in judge(clause, ["sh", "-c", script], patience_s=0.3).why


def test_a_failure_is_1_and_a_wrong_command_line_is_2(conform: Run) -> None:
    code, out, _ = conform("--only", "whole", "--only", "empty", "--", "true")
    assert code == 1
    assert out.splitlines()[0].startswith("FAIL whole ")
    assert out.splitlines()[-1] == "1 of 2 clauses hold"
    for arguments, message in (
        ((), "no command: write arva-hil conform -- ./my_decoder"),
        (("--", "/none/decoder"), "/none/decoder: cannot be started"),
        (("--only", "delt", "--", "true"), "no clause 'delt'; did you mean delta?"),
        (("--only", "unplugged", "--", "true"), "add --pty"),
    ):
        code, _, err = conform(*arguments)
        assert code == 2
        assert message in err
    code, out, err = conform("--only", "whole", "--junit", "-", "--", "true")
    assert (code, ElementTree.fromstring(out).attrib["failures"]) == (1, "1")
    assert err.startswith("FAIL whole ")
    code, out, _ = conform("--list")
    assert (code, len(out.splitlines())) == (0, 30)


def test_a_decoder_that_does_not_open_the_port_is_told_so(in_c: list[str]) -> None:
    (clause,) = (one for one in clauses() if one.name == "unplugged")
    assert "$ARVA_PORT" in judge(clause, ["sh", "-c", "sleep 60"], pty=True, patience_s=0.3).why
    assert judge(clause, in_c, pty=True).why == ""


def test_no_program_that_a_decoder_started_is_left(tmp_path: Path) -> None:
    (clause,) = (one for one in clauses() if one.name == "empty")
    os.mkfifo(tmp_path / "held")
    with open(os.open(tmp_path / "held", os.O_RDONLY | os.O_NONBLOCK), "rb") as held:
        assert not judge(clause, ["sh", "-c", f"sleep 60 >{tmp_path}/held & cat >/dev/null"], patience_s=60).why
        assert select.select([held], [], [], 10)[0]
        assert held.read(1) == b""  # nobody writes
