"""Other people's packages: tests/plugins/example adds one of each kind from outside; broken ones are named."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import jsonschema
import pytest
import yaml

from arva_hil import registry
from arva_hil.cli.main import main
from arva_hil.config import Fault, load, parse, to_dict
from arva_hil.registry import COMMANDS, EXPORTS, FAULTS, FORMATS, LINKS, OBSERVERS, RECEIVERS, STRATEGIES, Registry
from firmware_proto import Channel, Decoder, Frame, encode
from tests.files import written
from tests.made_records import write
from tests.said import says

from .far_ends import Arva, Autopilot

EXAMPLE = Path(__file__).parent.parent / "plugins" / "example"
LOG = Path(__file__).parent.parent / "data" / "arducopter.tlog"
REGISTRIES = [RECEIVERS, FORMATS, LINKS, FAULTS, STRATEGIES, OBSERVERS, EXPORTS, COMMANDS]
HOLD = "spec: 2\ntransmitters: [{id: 1, enu: [5, 20, 0]}]\nreceiver: {model: hold, %s}\n"


@pytest.fixture(autouse=True)
def _forget(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a test imported by name is imported anew in the next."""
    for of in REGISTRIES:
        monkeypatch.setattr(of, "loaded", {})
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in ("arva_example", "mine", "broken", "other"):
            del sys.modules[name]


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example package is installed."""
    monkeypatch.syspath_prepend(str(EXAMPLE))


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str, str, str], None]:
    """`install(package, group, entry, code)`: a package with one module of the same name and one entry point."""

    def add(package: str, group: str, entry: str, code: str) -> None:
        folder = tmp_path / package
        info = folder / f"{package}-2.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 2.0\n")
        (info / "entry_points.txt").write_text(f"[{group}]\n{entry}\n")
        (folder / f"{package}.py").write_text(code)
        monkeypatch.syspath_prepend(str(folder))

    return add


def scenario(folder: Path, own: str = "") -> Path:
    return written(folder / "hold.yaml", HOLD % own)


# -- one of each ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("of", REGISTRIES, ids=lambda of: of.group)
def test_the_example_adds_one_of_each_kind_and_it_has_what_it_needs(of: Registry, example: None) -> None:
    (name,) = set(of.names()) - set(of)
    assert name in of
    assert of._unfit(of[name]) == ""


@pytest.mark.usefixtures("example")
def test_a_record_is_written_in_another_s_format(arva: Arva, tmp_path: Path) -> None:
    arva("export", write(tmp_path / "flight", 7, search=False), "--out", tmp_path / "flight.counts")
    assert (tmp_path / "flight.counts").read_text() == "receiver: 7\n"


@pytest.mark.usefixtures("example")
def test_a_replay_with_another_s_model_format_fault_and_observer(arva: Arva, tmp_path: Path) -> None:
    file, out = scenario(tmp_path, "looks: 5"), tmp_path / "frames.hex"
    options = ("--scenario", file, "--format", "hex", "--fault", "reversed=1,first=9@2-5")
    options += ("--observer", f"count,out={tmp_path / 'counts.json'},least=2")
    arva("replay", LOG, *options, "--out", out)
    lines = out.read_bytes()
    assert lines.startswith(b"a457")
    assert b"754a" in lines  # backwards
    assert min(json.loads((tmp_path / "counts.json").read_text()).values()) >= 2
    made = json.loads((tmp_path / "counts.json").read_text())["FrameMade"]
    assert 0 < len(arva("listen", out, "--format", "hex", "--json").out.splitlines()) < made


@pytest.mark.usefixtures("example")
def test_a_model_s_own_keys_change_what_it_does_and_are_in_the_record(arva: Arva, tmp_path: Path) -> None:
    frames = []
    for looks in 1, 100:
        folder = tmp_path / str(looks)
        arva("replay", LOG, "--scenario", scenario(tmp_path, f"looks: {looks}"), "--record", folder)
        frames.append((folder / "frames.bin").read_bytes())
        assert json.loads((folder / "run.json").read_text())["scenario"]["receiver"]["looks"] == looks
    assert frames[0] != frames[1]


@pytest.mark.usefixtures("example")
def test_frames_go_to_a_link_of_another_package(arva: Arva, autopilot: Autopilot, tmp_path: Path) -> None:
    out = tmp_path / "frames"
    ran = arva("run", "--autopilot", autopilot.address, "--port", f"dump:{out}", "--duration", "1.2")
    assert f"frames to: dump:{out}" in ran.err
    assert len(Decoder().feed(out.read_bytes(), 0.0)) == 2
    words = ("run", "--autopilot", autopilot.address, "--port")
    assert "'dump:' has no path: write dump:/tmp/frames" in arva.refused(*words, "dump:")
    assert "cannot be written: No such file" in arva.refused(*words, f"dump:{tmp_path}/no/such", code=3)


@pytest.mark.undrawn
@pytest.mark.usefixtures("example")
def test_a_demo_flies_by_another_s_strategy_by_its_name_or_its_place(arva: Arva, tmp_path: Path) -> None:
    logs = []
    for name in "homing", "arva_example.strategy:Homing", "flux":
        words = "--limit", 4, "--headless", "--strategy", name, "--record", tmp_path / name
        arva("demo", "--speed", "max", *words, code=1)
        logs.append((tmp_path / name / "search.csv").read_text())
    assert logs[0].count("flying") > 15
    assert logs[0] == logs[1] != logs[2]


@pytest.mark.usefixtures("example")
def test_a_campaign_s_plan_may_name_them_too(arva: Arva, tmp_path: Path) -> None:
    plan = tmp_path / "plan.yaml"
    text = "strategies: [flux, homing, 'arva_example.strategy:Homing']\nscenarios: {random: {within_m: 10}}\n"
    plan.write_text(text + "height_m: {arva_example.strategy:Homing: 5}\n")
    assert "3 trials of flux, homing, arva_example.strategy:Homing" in arva("check", plan).out
    plan.write_text(text.replace("homing,", "homming,"))
    err = arva.refused("check", plan)
    assert (
        f"{plan}:1:20: strategies: 'homming', expected one of flux, extremum, estimate, homing, did you mean 'homing'?"
        in err
    )


@pytest.mark.usefixtures("example")
def test_a_file_may_name_another_s_fault_and_format(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    text = "transmitters: [{id: 1, enu: [5, 20, 0]}]\noutput: {format: hex}\nfaults: [{reversed: %s, from_s: 3}]\n"
    file.write_text(text % 0.5)
    says(arva("check", file).out, "1 Hz, hex", "fault reversed=0.5@3")
    file.write_text(text % 5)
    assert arva.refused("check", file) == f"{file}:3:21: reversed: '5', expected a probability above 0, at most 1\n"


@pytest.mark.usefixtures("example")
def test_a_command_of_another_package_has_help_options_and_an_exit_code(arva: Arva, tmp_path: Path) -> None:
    (tmp_path / "frames.bin").write_bytes(b"".join(encode(Frame(n, 1, (Channel(1, 1, 500, 3),))) for n in range(4)))
    assert arva("count-frames", tmp_path / "frames.bin", "--times", 3) == (0, "12\n", "")
    assert "\n  count-frames of the package arva-example 1.0\n" in arva("--help").out
    assert "--times" in arva("completion", "bash").out
    told = arva("count-frames", "--help").out
    assert told.startswith("usage: arva-hil count-frames ")
    assert "Count the frames in a file." in told
    assert arva.refused("count-frame") == "arva-hil: no command 'count-frame'; did you mean count-frames?\n"
    assert "required: FILE" in arva.refused("count-frames")


@pytest.mark.usefixtures("example")
def test_an_observer_is_named_by_its_place_too_and_its_options_are_checked(arva: Arva, tmp_path: Path) -> None:
    place = f"arva_example.observer:Count,out={tmp_path / 'counts.json'}"
    arva("replay", LOG, "--observer", place, "--out", tmp_path / "frames")
    assert json.loads((tmp_path / "counts.json").read_text())["FrameMade"] > 10
    for given, answer in {
        "count": "--observer count: ",
        "count,out": "'count,out': expected NAME,KEY=VALUE, each key once",
        "count,out=x,lest=3": "--observer count: options: 'lest', expected one of out, least",
        "count,out=x,least=few": "--observer count: least: 'few', expected a valid integer",
    }.items():
        assert answer in arva.refused("replay", LOG, "--observer", given, "--out", tmp_path / "frames")


@pytest.mark.usefixtures("example")
def test_own_keys_of_a_fault_are_checked_at_their_place_and_written_out(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    text = "transmitters: [{id: 1, enu: [5, 20, 0]}]\nfaults: [{reversed: 0.5, first: %s}]\n"
    file.write_text(text % 8)
    assert "fault reversed=0.5,first=8" in arva("check", file).out
    chosen = load(file)
    assert parse(json.dumps(to_dict(chosen)), "again") == chosen
    file.write_text(text % 1)
    assert arva.refused("check", file) == f"{file}:2:33: first: '1', expected greater than or equal to 2\n"
    assert Fault("reversed", 0.5).options.first == 1000


@pytest.mark.usefixtures("example")
def test_a_format_says_itself_that_it_carries_ids(arva: Arva) -> None:
    assert registry.formats_with_ids() == ["binary", "nmea", "hex"]
    assert not registry.over_mavlink("hex")
    assert {name for name in FORMATS if getattr(FORMATS[name], "over_mavlink", False)} == {*registry.MAVLINK_FORMATS}


# -- own keys ---------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("example")
@pytest.mark.parametrize(
    ("own", "problems"),
    [
        ("looks: 0", ["3:32: looks: '0', expected greater than or equal to 1"]),
        ("looks: many", ["3:32: looks: 'many', expected a valid integer\n"]),
        ("lokos: 5", ["3:25: unknown key 'lokos', expected one of", "did you mean 'looks'?"]),
        ("looks: 0, rate_hz: 99", ["3:32: looks: '0'", "3:44: rate_hz: '99', expected a number from 0.1 to 50"]),
        ("label: [1]", ["3:32: label: a list of 1, expected a valid string"]),
    ],
)
def test_a_mistake_in_a_model_s_own_keys_is_found_at_its_place(
    arva: Arva, tmp_path: Path, own: str, problems: list[str]
) -> None:
    err = arva.refused("check", scenario(tmp_path, own))
    assert all(problem in err for problem in problems), err


@pytest.mark.usefixtures("example")
def test_a_vehicle_s_receiver_takes_over_the_own_keys_of_the_same_model_only(tmp_path: Path) -> None:
    file = written(
        tmp_path / "fleet.yaml",
        HOLD % "looks: 7"
        + "vehicles:\n- name: a\n  receivers:\n  - {name: same, port: pty}\n  - {name: own, port: pty, looks: 9}\n"
        + "  - {name: other, port: pty, model: paper}\n",
    )
    from arva_hil.config import load, parse, to_dict

    read = load(file)
    same, own, other = read.vehicles[0].receivers
    assert (same.receiver.options.looks, own.receiver.options.looks, other.receiver.options) == (7, 9, None)
    assert parse(yaml.safe_dump(to_dict(read)), "again") == read


@pytest.mark.usefixtures("example")
def test_the_schema_knows_what_is_installed(arva: Arva) -> None:
    schema = jsonschema.Draft202012Validator(json.loads(arva("check", "--schema").out))
    for own, valid in {"looks: 3": True, "looks: 0": False, "lokos: 3": False}.items():
        assert schema.is_valid(yaml.safe_load(HOLD % own)) is valid


@pytest.mark.usefixtures("example")
def test_own_keys_in_python() -> None:
    from arva_hil.config import ReceiverOptions

    assert ReceiverOptions(model="hold").options.looks == 3
    assert ReceiverOptions(model="hold", options={"looks": 5}).options.looks == 5
    for options in {"looks": 0}, "five", {"lokos": 3}:
        with pytest.raises(ValueError, match=r"options|looks|lokos"):
            ReceiverOptions(model="hold", options=options)
    with pytest.raises(ValueError, match="paper has no keys of its own"):
        ReceiverOptions(options={"looks": 5})


# -- what is broken ---------------------------------------------------------------------------------------------

CASES = [
    ("arva_hil.receivers", "raise RuntimeError('not today')\n", "replay {log} --scenario {scenario}"),
    ("arva_hil.formats", "import no_such_thing\n", "listen pty --format bad"),
    ("arva_hil.links", "def bad(:\n", "listen bad:there"),
    ("arva_hil.faults", "raise SystemExit(3)\n", "replay {log} --fault bad=1"),
    ("arva_hil.strategies", "raise RuntimeError('not today')\n", "demo --strategy bad"),
    ("arva_hil.observers", "raise RuntimeError('not today')\n", "replay {log} --observer bad"),
]


@pytest.mark.parametrize(("group", "code", "command"), CASES)
@pytest.mark.parametrize("how", ["cannot be imported", "lacks"])
def test_a_package_that_cannot_be_used_is_named_with_the_cure(
    install: Callable[..., None], arva: Arva, tmp_path: Path, group: str, code: str, command: str, how: str
) -> None:
    install("broken", group, "bad = broken:Bad", code if how != "lacks" else "class Bad: ...\n")
    file = written(tmp_path / "s.yaml", "spec: 2\ntransmitters: [{id: 1, enu: [5, 20, 0]}]\nreceiver: {model: bad}\n")
    err = arva.refused(*command.format(log=LOG, scenario=file).split())
    says(err, f"'bad' of the package broken 2.0 {how}", "update that package, or uninstall it: pip uninstall broken")


def test_two_packages_with_one_name_are_refused_both(install: Callable[..., None], arva: Arva) -> None:
    for package in "broken", "other":
        install(package, "arva_hil.strategies", f"same = {package}:Same", "class Same: ...\n")
    err = arva.refused("demo", "--strategy", "same")
    says(err, "strategy 'same' is in 2 packages, ", "broken 2.0", "other 2.0", "uninstall one of them")


def test_a_built_in_name_cannot_be_taken_over(install: Callable[..., None]) -> None:
    install("broken", "arva_hil.strategies", "flux = broken:Flux", "class Flux: ...\n")
    assert STRATEGIES["flux"].__module__ == "arva_hil.search.strategies.flux"
    assert STRATEGIES.names() == ["flux", "extremum", "estimate"]


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("class Mine:\n    def hear(self, o): ...\n", "lacks velocity"),
        ("class Mine:\n    def velocity(self, t, p): ...\n", "lacks observe or hear"),
        (
            "class Mine:\n    def hear(self, o): ...\n    def velocity(self, t, p): ...\n",
            "cannot be created (TypeError",
        ),
        (
            "class Mine:\n    def __init__(self, speed): ...\n"
            "    def hear(self, o): ...\n    def velocity(self, t, p): ...\n",
            "lacks found",
        ),
        (
            "class Mine:\n    found = None\n    def __init__(self, speed): ...\n"
            "    def hear(self, o): ...\n    async def velocity(self, t, p): ...\n",
            "has async velocity; write def, not async def",
        ),
        (
            "class Mine:\n    def __init__(self, speed): raise SystemExit('no')\n"
            "    def hear(self, o): ...\n    def velocity(self, t, p): ...\n",
            "cannot be created (SystemExit: no)",
        ),
        (
            "class Mine:\n    def __init__(self, speed): ...\n    def observe(self, o): ...\n"
            "    def velocity(self, t, p): ...\n    found = property(lambda self: 1 / 0)\n",
            "cannot be created (ZeroDivisionError: division by zero)",
        ),
        ("import no_such_thing\n", "cannot be imported (ModuleNotFoundError: No module named 'no_such_thing')"),
        ("class Mine(:\n", "cannot be imported (SyntaxError: "),
        ("raise SystemExit('bye')\n", "cannot be imported (SystemExit: bye)"),
    ],
)
@pytest.mark.parametrize("command", ["demo", "search --autopilot pty --receiver pty"])
def test_a_strategy_of_one_s_own_is_checked_before_anything_flies(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, why: str, command: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(code)
    assert f"strategy 'mine:Mine' {why}" in arva.refused(*command.split(), "--strategy", "mine:Mine")


@pytest.mark.parametrize("name", ["mine", "random"])  # "random" is Python's too
def test_a_module_that_is_there_twice_is_refused_with_both_places(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Which one is flown would depend on where somebody stands."""
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in here, there:
        folder.mkdir()
        (folder / f"{name}.py").write_text("class Mine: ...\n")
    monkeypatch.chdir(here)
    monkeypatch.syspath_prepend(there)
    err = arva.refused("demo", "--strategy", f"{name}:Mine")
    count = 2 + (name == "random")
    says(
        err,
        f"strategy '{name}:Mine': there are {count} modules of that name, {there}/{name}.py and ",
        f"{here}/{name}.py",
        "rename yours, or take the other one out of PYTHONPATH",
    )


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("class Bad:\n    def __init__(self, x): ...\n    def observe(self, e): ...\n", "cannot be created (TypeError"),
        ("class Bad:\n    def observe(self, e): raise KeyError(5)\n", "Bad"),
        ("class Bad:\n    def observe(self, e): ...\n    def close(self): raise KeyError(5)\n", "close() failed"),
    ],
)
def test_an_observer_that_raises_stops_nothing(install: Callable[..., None], arva: Arva, code: str, said: str) -> None:
    install("broken", "arva_hil.observers", "bad = broken:Bad", code)
    assert said in arva("replay", LOG, "--observer", "bad", code=2 if "created" in said else 0).err


def test_the_registry_lists_every_kind_of_the_map() -> None:
    assert {of.group for of in vars(registry).values() if isinstance(of, Registry)} == {of.group for of in REGISTRIES}


COMMAND = """
def options(parser):
    \"\"\"Say hello.\"\"\"

def main(options):
    print("hello")
    return 0
"""


@pytest.mark.parametrize("name", ["speed", "math", "my.tool"])
def test_a_command_of_another_package_may_have_any_name(
    name: str, install: Callable[[str, str, str, str], None], capsys: pytest.CaptureFixture[str]
) -> None:
    install("mine", "arva_hil.commands", f"{name} = mine", COMMAND)
    assert main([name]) == 0
    assert capsys.readouterr().out == "hello\n"
