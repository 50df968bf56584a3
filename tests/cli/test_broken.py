"""What people get wrong: hundreds of broken files and command lines, and the answer that each has to get.

The corpus is tests/broken. There an entry is `=== TITLE`, a line `#> LINE:COLUMN: ANSWER` for every problem (`…` stands
for anything, `+` for further problems), and the file's text. files/ has those that no editor would leave as they are.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from arva_hil.safe_text import one_line
from tests.every import every
from tests.files import written

from .far_ends import Arva, Start

BROKEN = Path(__file__).parent.parent / "broken"
DATA = Path(__file__).parent.parent / "data"
GOOD = "transmitters: [{id: 1, ned: [1, 2, 3]}]\n"


class Entry(NamedTuple):
    title: str
    answers: list[str]
    data: bytes


def entries(path: Path) -> Iterator[Entry]:
    for part in re.split(rb"(?m)^(?==== )", path.read_bytes()):
        if part.startswith(b"=== "):
            head, *rest = part.decode().splitlines(keepends=True)
            answers = [line[3:].rstrip("\n") for line in rest if line.startswith("#> ")]
            yield Entry(head[4:].strip(), answers, part.split(b"\n", 1 + len(answers))[-1])


def params(found: dict[str, list[Entry]]) -> list[Any]:
    return [pytest.param(e, id=f"{name}: {e.title}") for name, all_of in found.items() for e in all_of]


SCENARIOS = {path.stem: list(entries(path)) for path in sorted(BROKEN.glob("scenarios/*.txt"))}
SCENARIOS["files"] = [e._replace(data=(BROKEN / "files" / e.title).read_bytes()) for e in entries(BROKEN / "files.txt")]
FIRST = [all_of[0] for all_of in SCENARIOS.values()]
CAMPAIGNS = {"campaigns": list(entries(BROKEN / "campaigns.txt"))}


def command_lines() -> list[tuple[str, list[str]]]:
    """What is typed, and what the answer has to have."""
    parts = re.split(r"(?m)^\$ ", (BROKEN / "command_lines.txt").read_text(encoding="utf-8"))[1:]
    return [(lines[0], [line[2:] for line in lines if line.startswith("> ")]) for lines in map(str.splitlines, parts)]


def matches(answer: str, line: str) -> bool:
    return re.fullmatch(".*".join(map(re.escape, answer.split("…"))), line) is not None


def check_answers(err: str, entry: Entry) -> None:
    """Each problem where and as the entry has it, one a line, and nothing else."""
    assert "Traceback" not in err
    lines = err.rstrip("\n").split("\n")
    wanted = [f"f.yaml:{a}" if a[0].isdigit() else a for a in entry.answers if a != "+"]
    assert wanted
    for answer, line in zip(wanted, lines, strict="+" not in entry.answers):
        assert matches(answer, line), line


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where everything is, and what is not broken there."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


# -- scenarios ---------------------------------------------------------------------------------------------


@every("entry", params(SCENARIOS))
def test_a_broken_scenario_is_answered_at_its_place_and_alike_by_check_and_run(arva: Arva, entry: Entry) -> None:
    Path("f.yaml").write_bytes(entry.data)
    err = arva.refused("check", "f.yaml")
    check_answers(err, entry)
    if entry in FIRST:
        assert arva.refused("run", "--port", "pty", "--scenario", "f.yaml") == f"arva-hil: {err}"


def shape(entry: Entry) -> str:
    """The first answer without its place, its key and what was found."""
    return re.sub(r"^\d+:\d+: (\w+: )?((the text )?('[^']*'|\"[^\"]*\"))?", "", entry.answers[0])


def test_there_are_hundreds_and_they_differ() -> None:
    every = [entry for all_of in SCENARIOS.values() for entry in all_of]
    assert len(every) >= 300
    assert len({entry.data for entry in every}) == len(every)
    assert len({entry.title for entry in every}) == len(every)
    shapes = Counter(map(shape, every))
    assert len(shapes) >= 200
    assert max(shapes.values()) <= 15
    assert {path.name for path in (BROKEN / "files").glob("[!.]*")} == {e.title for e in SCENARIOS["files"]}


SOCKET = f"{sys.executable} -c \"import socket; socket.socket(socket.AF_UNIX).bind('f.yaml')\""


@pytest.mark.parametrize(
    ("made", "name", "answer"),
    [
        ("head -c 1048577 /dev/zero | tr '\\0' '#' >f.yaml", "f.yaml", "more than 1 MiB"),
        ("mkdir f.yaml", "f.yaml", "Is a directory"),
        ("mkfifo f.yaml", "f.yaml", "an empty file"),
        ("ln -s f.yaml f.yaml", "f.yaml", "Too many levels of symbolic links"),
        ("ln -s nowhere.yaml f.yaml", "f.yaml", "No such file or directory"),
        (SOCKET, "f.yaml", "No such device or address"),
        ("touch f.yaml", "f.yaml/f.yaml", "Not a directory"),
        ("", "/dev/null", "an empty file"),
        ("", "/dev/zero", "more than 1 MiB"),
        ("", "f" * 300, "File name too long"),
        ("", "f.yaml\0", "embedded null byte"),
        ("", "f.yaml/", "No such file or directory"),
        ("", "", "an empty name"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="files as Unix has them")
def test_what_is_no_file_to_read_is_answered_without_waiting(arva: Arva, made: str, name: str, answer: str) -> None:
    subprocess.run(made, shell=True, check=True)
    quoted = one_line(name) or "''"
    assert arva.refused("check", name).startswith(f"{quoted}:1:1: {answer}, expected a ")


@pytest.mark.skipif(sys.platform == "win32", reason="files as Unix has them")
def test_a_pipe_that_is_written_to_is_read(arva: Arva) -> None:
    read, write = os.pipe()
    os.write(write, GOOD.encode())
    os.close(write)
    try:
        arva("check", f"/dev/fd/{read}")
    finally:
        os.close(read)


@pytest.mark.skipif(sys.platform == "win32", reason="files as Unix has them")
def test_a_terminal_is_no_scenario(arva: Arva) -> None:
    ends = os.openpty()
    try:
        name = os.ttyname(ends[1])
        assert arva.refused("check", name) == f"{name}:1:1: a terminal, expected a scenario file\n"
    finally:
        for end in ends:
            os.close(end)


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("check {f}", "{f}:1:1: Permission denied, expected a scenario file"),
        ("run --port pty --scenario {f}", "arva-hil: {f}:1:1: Permission denied, expected a scenario file"),
        ("campaign {f}", "arva-hil: {f}:1:1: Permission denied, expected the plan of a campaign"),
        ("replay {f}", "arva-hil: {f}: permission denied"),
        ("listen {f}", "arva-hil: {f}: cannot be read: Permission denied"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="permissions as Unix has them")
def test_what_may_not_be_read_is_answered(
    arva: Arva, ordinary: Callable[[], AbstractContextManager[None]], command: str, answer: str
) -> None:
    with tempfile.TemporaryDirectory() as name:
        os.chmod(name, 0o755)
        file = written(Path(name, "f.yaml"), GOOD)
        file.chmod(0)
        arva(*command.format(f="none.yaml").split(), code=2)  # what it imports, it imports as root
        with ordinary():
            assert arva.refused(*command.format(f=file).split()).startswith(answer.format(f=file))


def test_each_of_several_files_is_answered(arva: Arva) -> None:
    Path("good.yaml").write_text(GOOD)
    Path("broken.yaml").write_text(GOOD + "seed: x\n")
    _, out, err = arva("check", "broken.yaml", "good.yaml", "none.yaml", code=2)
    assert out.startswith("good.yaml: ok")
    assert [line.split(": ")[0] for line in err.splitlines()] == ["broken.yaml:2:7", "none.yaml:1:1"]


# -- plans of campaigns, logs ------------------------------------------------------------------------------


@every("entry", params(CAMPAIGNS))
def test_a_broken_plan_is_answered_at_its_place(arva: Arva, entry: Entry) -> None:
    Path("good.yaml").write_text(GOOD)
    Path("broken.yaml").write_text(GOOD + "seed: x\n")
    Path("f.yaml").write_bytes(entry.data)
    err = arva.refused("campaign", "f.yaml")
    assert err.startswith("arva-hil: ")
    check_answers(err.removeprefix("arva-hil: "), entry)
    assert {path.name for path in Path().iterdir()} == {"f.yaml", "good.yaml", "broken.yaml"}, "nothing was written"


@pytest.mark.parametrize(
    ("data", "answer"),
    [
        (b"", "no MAVLink packet in its 0 bytes"),
        (GOOD.encode(), "no MAVLink packet in its 40 bytes"),
        (b"\xfd" * 1000, "no MAVLink packet in its 1000 bytes"),
        (bytes(range(256)) * 8, "no MAVLink packet in its 2048 bytes"),
        (bytes.fromhex("a457011b2a010401 01d204110000ff00ffffffff"), "no MAVLink packet in its 20 bytes"),
        (b"PK\x03\x04" + bytes(100), "no MAVLink packet in its 104 bytes"),
        (b"\xa3\x95\x80\x80\x59FMT\0" + bytes(300), "no MAVLink packet in its 309 bytes"),
        (b"ULog\x01\x12\x35\x01" + bytes(300), "no MAVLink packet in its 308 bytes"),
        (b"\xfd\x09\0\0\0\1\1\0\0\0" + bytes(11), "no MAVLink packet in its 21 bytes"),
    ],
    ids=["empty", "a scenario", "magics", "every byte", "frames", "a zip", "a dataflash log", "a ulog", "no times"],
)
def test_what_is_no_log_is_answered(arva: Arva, data: bytes, answer: str) -> None:
    Path("flight.tlog").write_bytes(data)
    said = f"arva-hil: flight.tlog: {answer}: is it a telemetry log?\n"
    assert arva.refused("replay", "flight.tlog", "--record", "record") == said
    assert not Path("record").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="files as Unix has them")
def test_a_pipe_is_no_log(arva: Arva) -> None:
    os.mkfifo("flight.tlog")
    assert arva.refused("replay", "flight.tlog") == "arva-hil: flight.tlog: is not a regular file\n"


# -- command lines -----------------------------------------------------------------------------------------


def words(line: str, folder: Path) -> tuple[dict[str, str], list[str]]:
    """Environment and arguments of what is typed."""
    (folder / "good.yaml").write_text(GOOD)
    (folder / "broken.yaml").write_text(GOOD + "seed: x\n")
    (folder / "folder").mkdir(exist_ok=True)
    environment: dict[str, str] = {}
    parts = [fill(part, folder) for part in shlex.split(line)]
    while parts[0] != "arva-hil":
        name, _, environment[name] = parts.pop(0).partition("=")
    return environment, parts[1:]


def fill(text: str, folder: Path) -> str:
    names = {"log": DATA / "px4.tlog", "good": "good.yaml", "broken": "broken.yaml", "folder": "folder"}
    for name, path in names.items():
        text = text.replace(f"{{{name}}}", str(folder / path))
    return text


@every("line, answers", command_lines())
def test_a_wrong_command_line_is_answered(arva: Arva, folder: Path, line: str, answers: list[str]) -> None:
    environment, arguments = words(line, folder)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            patch.setenv(name, value)
        err = arva.refused(*arguments)
    assert re.search("(?m)^arva-hil: ", err) or arguments[0] == "check"
    assert [answer for answer in answers if fill(answer, folder) not in err] == [], err
    assert answers


def test_there_are_many_of_every_command() -> None:
    lines = [line for line, _ in command_lines()]
    assert len(set(lines)) == len(lines) >= 300
    commands = Counter(next((w for w in shlex.split(line) if w.isalpha()), "") for line in lines)
    for name in ("run", "replay", "demo", "search", "campaign", "listen", "check", "ports"):
        assert commands[name] >= 2, name


PROCESSES = [
    ([b"--port", b"\xff\xfe"], {}, r"'\udcff\udcfe' is no connection"),
    ([b"check", b"\xe9t\xe9.yaml"], {}, r"\udce9t\udce9.yaml:1:1: No such file or directory"),
    ([b"r\xfcn"], {}, r"no command 'r\udcfcn'"),
    ([b"run", b"--port", b"pty"], {b"ARVA_HIL_FORMAT": b"\xff"}, r"ARVA_HIL_FORMAT=\udcff"),
    ([b"run", b"--port", b"pty", b"--fault", b"\x80"], {}, r"'\udc80'"),
    ([b"listen", b"x" * 100_000], {}, "no connection"),
    ([b"replay", b"\n\x1b[31m.tlog"], {}, "no such file"),
]


@pytest.mark.parametrize(("arguments", "environment", "answer"), PROCESSES, ids=[p[2][:40] for p in PROCESSES])
@pytest.mark.skipif(sys.platform == "win32", reason="arguments of bytes")
def test_a_process_ends_with_2_and_no_traceback(
    start: Start, arguments: list[bytes], environment: dict[bytes, bytes], answer: str
) -> None:
    bytes_first = arguments[0] == b"--port"  # with an interpreter of its own, which makes text of them
    more = {os.fsdecode(name): os.fsdecode(value) for name, value in environment.items()}
    program = start(*map(os.fsdecode, arguments), fresh=bytes_first, env={**os.environ, **more})
    assert answer in program.ends(2)
    assert program.out == b""
