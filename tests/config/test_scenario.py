"""The scenario file: what is read, what is refused and where, and that nothing else is ever raised."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from arva_hil.config import (
    DEFAULT,
    Lla,
    MountOptions,
    Noise,
    ReceiverOptions,
    Scenario,
    ScenarioError,
    Transmitter,
    load,
    parse,
    to_dict,
)
from arva_hil.registry import FORMATS
from tests.every import every

CONFIGS = Path(__file__).parents[2] / "configs"
ONE = "transmitters: [{id: 1, ned: [1, 2, 3]}]\n"  # a valid line 1: what is appended starts at line 2


def mistakes(text: str) -> list[str]:
    """The message lines for a broken file, without the file's name."""
    with pytest.raises(ScenarioError) as caught:
        parse(text, "f.yaml")
    lines = str(caught.value).split("\n")
    assert [str(problem) for problem in caught.value.problems] == lines
    assert all(line.startswith("f.yaml:") for line in lines)
    return [line.removeprefix("f.yaml:") for line in lines]


# What is read


def test_a_full_file_is_read_as_written() -> None:
    text = """
spec: 1
datum: {lat: 46.0123, lon: 7.7456, alt: 1650}
transmitters:
  - {id: 0, enu: [20, 5, -1.5], attitude: {yaw: 30}}
  - {id: 254, ned: [1e3, -.5, +2.], strength: 0.5}
  - {id: 7, lla: [46, -7.5, 1700], attitude: {roll: 1, pitch: -2, yaw: 3}}
receiver:
  channels: 2
  rate_hz: 10
  jitter_s: 0.049
  kappa_eq: 2
  sensitivity: [1, 1, 0.5]
  noise: {kind: off, floor_range_m: 60}
  mount: {position: [0.1, 0, -0.2], attitude: {roll: 0, pitch: 0, yaw: 90}}
  no_signal: [-1, 0]
output: {format: nmea}
seed: 9223372036854775807
"""
    assert parse(text, "f.yaml") == Scenario(
        transmitters=(
            Transmitter(0, ned=(5.0, 20.0, 1.5), attitude=(0.0, 0.0, 30.0)),
            Transmitter(254, ned=(1000.0, -0.5, 2.0), strength=0.5),
            Transmitter(7, lla=Lla(46.0, -7.5, 1700.0), attitude=(1.0, -2.0, 3.0)),
        ),
        datum=Lla(46.0123, 7.7456, 1650.0),
        receiver=ReceiverOptions(
            channels=2,
            rate_hz=10.0,
            jitter_s=0.049,
            kappa_eq=2.0,
            sensitivity=(1.0, 1.0, 0.5),
            noise=Noise("off", 60.0),
            mount=MountOptions((0.1, 0.0, -0.2), (0.0, 0.0, 90.0)),
            no_signal=(-1, 0),
        ),
        output_format="nmea",
        seed=2**63 - 1,
    )


def test_everything_but_transmitters_has_the_pinned_default() -> None:
    scenario = parse(ONE, "f.yaml")
    assert to_dict(scenario) == {
        "spec": 1,
        "datum": "home",
        "transmitters": [{"id": 1, "ned": [1, 2, 3], "attitude": {"roll": 0, "pitch": 0, "yaw": 0}, "strength": 1}],
        "receiver": {
            "channels": 4,
            "rate_hz": 1,
            "jitter_s": 0,
            "kappa_eq": 1.542,
            "sensitivity": [1, 0.8, 0.6],
            "noise": {"kind": "uniform", "floor_range_m": 80},
            "mount": {"position": [0, 0, 0], "attitude": {"roll": 0, "pitch": 0, "yaw": 0}},
            "no_signal": [-1, -1],
        },
        "output": {"format": "binary"},
        "seed": 1,
        "faults": [],
    }
    assert scenario.source == "f.yaml"


def test_default_is_20_m_north_and_5_m_east_of_home() -> None:
    assert replace(parse(ONE, ""), transmitters=(Transmitter(1, ned=(20, 5, 0)),)) == DEFAULT


def test_default_yaml_is_the_default_with_every_key_written_out() -> None:
    path = CONFIGS / "default.yaml"
    assert load(path) == DEFAULT
    assert yaml.safe_load(path.read_text()) == to_dict(DEFAULT)


@every("path", sorted(CONFIGS.glob("*.yaml")))
def test_every_config_loads_and_starts_with_what_it_shows(path: Path) -> None:
    assert load(path).source == str(path)
    assert path.read_text().startswith("# ")


@every("number, ned", [(1, (5, 20, 0)), (2, (0, 10, -1)), (3, (-20, 20, 1)), (4, (5, -6, 0))])
def test_paper_cases_are_where_the_paper_has_them(number: int, ned: tuple[float, float, float]) -> None:
    (transmitter,) = load(CONFIGS / f"paper_case_{number}.yaml").transmitters
    assert transmitter.ned == ned
    assert load(CONFIGS / "four_transmitters.yaml").transmitters[number - 1].ned == ned


def test_a_byte_order_mark_and_windows_line_ends_are_read(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + ONE.encode() + b"seed: 5\r\noutput: {format: text}\r\n")
    assert (load(path).seed, load(path).output_format) == (5, "text")


@pytest.mark.parametrize(
    ("module", "absent"),
    [("scenario", ["numpy", "importlib.metadata"]), ("common", ["numpy"])],
)
def test_importing_it_does_not_import_what_is_slow(module: str, absent: list[str]) -> None:
    code = f"import sys, arva_hil.config.{module}; sys.exit(bool(set({absent}) & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# Round trip

unit = st.floats(0, 1, exclude_min=True)
degrees = st.tuples(*[st.floats(-360, 360)] * 3)
world = st.tuples(*[st.floats(-1e6, 1e6)] * 3)
places = st.builds(Lla, lat=st.floats(-90, 90), lon=st.floats(-180, 180), alt=st.floats(-500, 9000))
strengths = st.floats(0, 1000, exclude_min=True)
transmitters = st.one_of(
    st.builds(Transmitter, id=st.integers(0, 254), ned=world, attitude=degrees, strength=strengths),
    st.builds(Transmitter, id=st.integers(0, 254), lla=places, attitude=degrees, strength=strengths),
)
receivers = st.floats(0.1, 50).flatmap(
    lambda rate_hz: st.builds(
        ReceiverOptions,
        channels=st.integers(1, 16),
        rate_hz=st.just(rate_hz),
        jitter_s=st.floats(0, 0.5 / rate_hz, exclude_max=True),
        kappa_eq=st.floats(0, 1000, exclude_min=True),
        sensitivity=st.tuples(unit, unit, unit),
        noise=st.builds(Noise, st.sampled_from(["uniform", "gaussian", "off"]), st.floats(0.01, 1e6)),
        mount=st.builds(MountOptions, st.tuples(*[st.floats(-100, 100)] * 3), degrees),
        no_signal=st.sampled_from([(-1, -1), (-1, 0), (0, 0)]),
    )
)
scenarios = st.builds(
    Scenario,
    transmitters=st.lists(transmitters, min_size=1, max_size=5, unique_by=lambda t: t.id).map(tuple),
    datum=st.just("home") | places,
    receiver=receivers,
    output_format=st.sampled_from(list(FORMATS)),
    seed=st.integers(0, 2**63 - 1),
)


@given(scenarios)
@settings(deadline=None)
def test_written_and_read_back_it_is_equal(scenario: Scenario) -> None:
    plain = to_dict(scenario)
    assert json.loads(json.dumps(plain)) == plain  # JSON types only
    for text in (json.dumps(plain), json.dumps(plain, indent=2), yaml.safe_dump(plain)):
        assert parse(text, "f.yaml") == scenario


# What is refused, and where


@every(
    "text, expected",
    [
        ("datum: Home", "8: datum: 'Home', expected home or a mapping with lat, lon, alt, did you mean 'home'?"),
        ("datum: [46, 7]", "8: datum: a list of 2, expected home or a mapping with lat, lon, alt"),
        ("datum: {lat: 1, alt: 2}", "8: no lon, expected a mapping with lon"),
        ("datum: {lat: 90.1, lon: 0, alt: 0}", "14: lat: '90.1', expected a latitude from -90 to 90"),
        ("datum: {lat: 0, lon: 181, alt: 0}", "22: lon: '181', expected a longitude from -180 to 180"),
        ("datum: {lat: 0, lon: 0, alt: 9001}", "30: alt: '9001', expected an altitude from -500 to 9000"),
        ("receiver:", "10: receiver: nothing, expected a mapping with channels, rate_hz, jitter_s, kappa_eq, "
         "sensitivity, noise, mount, no_signal"),
        ("receiver: {channels: 0}", "22: channels: '0', expected a whole number from 1 to 16"),
        ("receiver: {channels: 17}", "22: channels: '17', expected a whole number from 1 to 16"),
        ("receiver: {channels: 4.0}", "22: channels: '4.0', expected a whole number from 1 to 16"),
        ("receiver: {channels: 010}", "22: channels: '010', expected a whole number from 1 to 16"),
        ("receiver: {channels: '4'}", "22: channels: the text '4', expected a whole number from 1 to 16"),
        ("receiver: {channels: ''}", "22: channels: the text '', expected a whole number from 1 to 16"),
        ("receiver: {channels: yes}", "22: channels: 'yes', expected a whole number from 1 to 16"),
        ("receiver: {rate_hz: 0.09}", "21: rate_hz: '0.09', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: 50.1}", "21: rate_hz: '50.1', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: 01}", "21: rate_hz: '01', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: true}", "21: rate_hz: 'true', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: '1'}", "21: rate_hz: the text '1', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: 1_0}", "21: rate_hz: '1_0', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: 0x1}", "21: rate_hz: '0x1', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: 1:30}", "21: rate_hz: '1:30', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: ١}", "21: rate_hz: '١', expected a number from 0.1 to 50"),
        ("receiver: {rate_hz: {a: 1}}", "21: rate_hz: a mapping, expected a number from 0.1 to 50"),
        ("receiver: {kappa_eq: .nan}", "22: kappa_eq: '.nan', expected a number above 0, at most 1000"),
        ("receiver: {kappa_eq: nan}", "22: kappa_eq: 'nan', expected a number above 0, at most 1000"),
        ("receiver: {kappa_eq: .inf}", "22: kappa_eq: '.inf', expected a number above 0, at most 1000"),
        ("receiver: {kappa_eq: infinity}", "22: kappa_eq: 'infinity', expected a number above 0, at most 1000"),
        ("receiver: {kappa_eq: 1e999}", "22: kappa_eq: '1e999', expected a number above 0, at most 1000"),
        ("receiver: {kappa_eq: 0}", "22: kappa_eq: '0', expected a number above 0, at most 1000"),
        ("receiver: {jitter_s: -0.1}", "22: jitter_s: '-0.1', expected a number from 0 to 5"),
        ("receiver: {jitter_s: 0.5}", "22: jitter_s 0.5, expected less than half the period (0.5 s)"),
        ("receiver: {rate_hz: 10, jitter_s: 0.05}",
         "35: jitter_s 0.05, expected less than half the period (0.05 s)"),
        ("receiver: {rate_hz: slow, jitter_s: 4}", "21: rate_hz: 'slow', expected a number from 0.1 to 50"),
        ("receiver: {sensitivity: [1, 0, 1]}", "29: sensitivity: '0', expected a number above 0, at most 1"),
        ("receiver: {sensitivity: [1, 1, 1.1]}", "32: sensitivity: '1.1', expected a number above 0, at most 1"),
        ("receiver: {sensitivity: [1, 1]}", "25: sensitivity: 2 numbers, expected 3 (x, y, z)"),
        ("receiver: {sensitivity: 1}", "25: sensitivity: '1', expected a list of 3 numbers (x, y, z)"),
        ("receiver: {noise: off}",
         "19: noise: 'off', expected a mapping with kind, floor_range_m"),
        ("receiver: {noise: {kind: Gausian}}",
         "26: kind: 'Gausian', expected one of uniform, gaussian, off, did you mean 'gaussian'?"),
        ("receiver: {noise: {kind: }}", "25: kind: nothing, expected one of uniform, gaussian, off"),
        ("receiver: {noise: {floor_range_m: 0}}", "35: floor_range_m: '0', expected a number from 0.01 to 1000000"),
        ("receiver: {noise: {floor_range_m: 1e-110}}",
         "35: floor_range_m: '1e-110', expected a number from 0.01 to 1000000"),
        ("receiver: {mount: {position: [0, 0, 101]}}", "37: position: '101', expected a number from -100 to 100"),
        ("receiver: {mount: {attitude: {yaw: 361}}}", "36: yaw: '361', expected a number from -360 to 360"),
        ("receiver: {mount: {attitude: [0, 0, 9]}}", "30: attitude: a list of 3, expected a mapping with roll"
         ", pitch, yaw"),
        ("receiver: {no_signal: [0, -1]}", "23: no_signal: [0, -1], expected [-1, -1], [-1, 0] or [0, 0]"),
        ("receiver: {no_signal: [x, -1]}", "24: no_signal: 'x', expected a whole number from -1 to 0"),
        ("receiver: {no_signal: [0, x]}", "27: no_signal: 'x', expected a whole number from -1 to 0"),
        ("receiver: {no_signal: -1}", "23: no_signal: '-1', expected a list of 2 whole numbers"),
        ("output: nmea", "9: output: 'nmea', expected a mapping with format"),
        ("output: {format: debugvect}",
         "18: format: 'debugvect', expected one of binary, nmea, text, handheld, vector, rssi, tunnel, named, "
         "named_float, debug_vect, "
         "did you mean 'debug_vect'?"),
        ("seed: -1", "7: seed: '-1', expected a whole number from 0 to 9223372036854775807"),
        ("seed: 9223372036854775808",
         "7: seed: '9223372036854775808', expected a whole number from 0 to 9223372036854775807"),
        ("seed: 1" + "0" * 5000,
         "7: seed: '1" + "0" * 38 + "…', expected a whole number from 0 to 9223372036854775807"),
        ("spec: 0", "7: spec: '0', expected a spec from 1 to 2"),
        ("spec: 1.0", "7: spec: '1.0', expected a spec from 1 to 2"),
        ("spec: two", "7: spec: 'two', expected a spec from 1 to 2"),
        ("spec: 3\nunknown: here",
         "7: spec 3 is newer than this program reads (2): upgrade arva-hil, expected spec 2"),
        ("recever: {}", "1: unknown key 'recever', expected one of spec, transmitters, datum, receiver, output, "
         "seed, faults, did you mean 'receiver'?"),
        ("SEED: 1", "1: unknown key 'SEED', expected one of spec, transmitters, datum, receiver, output, seed, "
         "faults, did you mean 'seed'?"),
        ("zzz: 1", "1: unknown key 'zzz', expected one of spec, transmitters, datum, receiver, output, seed, faults"),
        ("<<: {seed: 1}",
         "1: unknown key '<<', expected one of spec, transmitters, datum, receiver, output, seed, faults"),
        ("? [a]\n: 1",
         "3: unknown key a list of 1, expected one of spec, transmitters, datum, receiver, output, seed, faults"),
        ("seed: !!python/object:os.system {}",
         "7: the tag '!!python/object:os.system', expected a value without a tag"),
        ("seed: !!int 3", "7: the tag '!!int', expected a value without a tag"),
    ],
)  # fmt: skip
def test_a_mistake_on_line_2(text: str, expected: str) -> None:
    assert mistakes(ONE + text) == ["2:" + expected]


TRANSMITTER = "id, enu, ned, lla, attitude, strength"
TOP = "spec, transmitters, datum, receiver, output, seed, faults"


@every(
    "text, expected",
    [
        ("seed: 1", ["1:1: no transmitters, expected a mapping with transmitters"]),
        ("# only\n\nseed: 1", ["3:1: no transmitters, expected a mapping with transmitters"]),
        ("transmitters:", ["1:14: transmitters: nothing, expected a list of 1 to 255 transmitters"]),
        ("transmitters: []", ["1:15: transmitters: a list of 0, expected a list of 1 to 255 transmitters"]),
        ("transmitters: {id: 1}", ["1:15: transmitters: a mapping, expected a list of 1 to 255 transmitters"]),
        ("transmitters:\n  - 5", [f"2:5: transmitters: '5', expected a mapping with {TRANSMITTER}"]),
        (
            "transmitters:\n  - strength: 0\n    attitude: {roll: north}\n",
            [
                "2:5: no id, expected a mapping with id",
                "2:5: no enu or ned or lla, expected a mapping with exactly one of enu, ned, lla",
                "2:15: strength: '0', expected a number above 0, at most 1000",
                "3:22: roll: 'north', expected a number from -360 to 360",
            ],
        ),
        (
            "transmitters:\n- {id: 255, enu: [1e7, 0, 0]}\n- {id: -1, ned: [0, -1000000.1, 0]}\n",
            [
                "2:8: id: '255', expected a whole number from 0 to 254",
                "2:19: enu: '1e7', expected a number from -1000000 to 1000000",
                "3:8: id: '-1', expected a whole number from 0 to 254",
                "3:21: ned: '-1000000.1', expected a number from -1000000 to 1000000",
            ],
        ),
        (
            "transmitters:\n- id: 7\n  ned: [1, 2, 3]\n- {id: 7, lla: [91, 181, -501]}\n"
            "- {id: x, ned: [1, 2]}\n- {id: x, ned: [1, 2, '3']}\n- {id: 7, ned: [1, 2, 3], strength: 1001}\n",
            [
                "4:8: id 7 again (first on line 2), expected an id of its own",
                "4:17: lla: '91', expected a latitude from -90 to 90",
                "4:21: lla: '181', expected a longitude from -180 to 180",
                "4:26: lla: '-501', expected an altitude from -500 to 9000",
                "5:8: id: 'x', expected a whole number from 0 to 254",
                "5:16: ned: 2 numbers, expected 3 (north, east, down)",
                "6:8: id: 'x', expected a whole number from 0 to 254",
                "6:23: ned: the text '3', expected a number from -1000000 to 1000000",
                "7:8: id 7 again (first on line 2), expected an id of its own",
                "7:37: strength: '1001', expected a number above 0, at most 1000",
            ],
        ),
        (
            "transmitters:\n  - id: 1\n    lla: [1, 2, 3]\n    ned: [1, 2, 3]\n    enu: [1, 2, x]\n",
            [
                "4:5: both lla and ned, expected a mapping with exactly one of enu, ned, lla",
                "5:5: both lla and enu, expected a mapping with exactly one of enu, ned, lla",
                "5:17: enu: 'x', expected a number from -1000000 to 1000000",
            ],
        ),
        (
            "seed: 1.5\ntransmiters: []\nreceiver:\n  chanels: 3\n  rate_hz: 1 Hz\n  rate_hz: 2\nseed: 3\n",
            [
                "1:1: no transmitters, expected a mapping with transmitters",
                "1:7: seed: '1.5', expected a whole number from 0 to 9223372036854775807",
                f"2:1: unknown key 'transmiters', expected one of {TOP}, did you mean 'transmitters'?",
                "4:3: unknown key 'chanels', expected one of channels, rate_hz, jitter_s, kappa_eq, sensitivity, "
                "noise, mount, no_signal, did you mean 'channels'?",
                "5:12: rate_hz: '1 Hz', expected a number from 0.1 to 50",
                "6:3: key 'rate_hz' again (first on line 5), expected each key once",
                "7:1: key 'seed' again (first on line 1), expected each key once",
            ],
        ),
        (
            ONE + "seed: &seed 3\ndatum: *seed\n? !!str output\n: {format: !x [*seed]}\nreceiver: {channels: 0}\n",
            [
                "3:8: the alias *seed, expected the value itself",
                "4:3: the tag '!!str', expected a value without a tag",
                "5:12: the tag '!x', expected a value without a tag",
                "5:16: the alias *seed, expected the value itself",
                "6:22: channels: '0', expected a whole number from 1 to 16",
            ],
        ),
        (
            "transmitters:\n- !python/object:os.system\n- *undefined\n- {id: !!int 3}\n",
            [
                "2:3: the tag '!python/object:os.system', expected a value without a tag",
                "3:3: the alias *undefined, expected the value itself",
                "4:3: no enu or ned or lla, expected a mapping with exactly one of enu, ned, lla",
                "4:8: the tag '!!int', expected a value without a tag",
            ],
        ),
    ],
)  # fmt: skip
def test_every_mistake_is_listed(text: str, expected: list[str]) -> None:
    assert mistakes(text) == expected


@every(
    "text, expected",
    [
        ("", "1:1: an empty file, expected a mapping with transmitters"),
        ("---\n...\n", f"2:1: nothing, expected a mapping with {TOP}"),
        ("- 1\n", f"1:1: a list of 1, expected a mapping with {TOP}"),
        ("hello", f"1:1: 'hello', expected a mapping with {TOP}"),
        (ONE + "---\nseed: 2\n", "2:1: a second document, expected one"),
        (ONE + "seed:\t1", "2:6: a tab, expected spaces"),
        (ONE + "output:\n\tformat: nmea", "3:1: a tab, expected spaces"),
        (ONE + "seed: 1\x00", "2:8: the character '\\x00', expected printable text"),
        ("seed: \ud800", "1:7: the character '\\ud800', expected printable text"),
        ('seed: "\\UFFFFFFFF"', "1:10: not YAML (a number too large), expected a smaller one"),
        (
            ONE + "seed: a: 1",
            "2:8: not YAML (mapping values are not allowed here), "
            "expected indentation, brackets and quotes that match",
        ),
        (
            "transmitters: [{id: 1,\n",
            "2:1: not YAML (while parsing a flow node, expected the node content, but found '<stream end>'), "
            "expected indentation, brackets and quotes that match",
        ),
        ("[" * 100_000, "1:21: more than 20 levels, expected fewer"),
        ("- " * 500, "1:41: more than 20 levels, expected fewer"),
        ("{a: " * 500, "1:78: more than 20 levels, expected fewer"),
        ("".join(f"key_{n}: 1\n" for n in range(1_100)), "1001:1: more than 1000 keys, expected fewer"),
        (
            "transmitters:\n" + "- {id: 1, enu: [5, 20, 0]}\n" * 1_100,
            "1002:3: more than 1000 mappings in a list, expected fewer",
        ),
    ],
)  # fmt: skip
def test_what_is_not_a_scenario_at_all(text: str, expected: str) -> None:
    assert mistakes(text) == [expected]


def test_mistakes_before_a_syntax_error_are_listed_with_it() -> None:
    assert mistakes("datum: *x\nseed: a: 1\n") == [
        "1:8: the alias *x, expected the value itself",
        "2:8: not YAML (mapping values are not allowed here), expected indentation, brackets and quotes that match",
    ]


def test_a_billion_laughs_is_a_list_of_mistakes() -> None:
    text = "a0: &a0 [lol]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 50))
    found = mistakes(text + "transmitters: *a49\n")
    assert len(found) == 50 + 49 * 9 + 1
    assert found[-1] == "51:15: the alias *a49, expected the value itself"


def test_255_transmitters_are_read_and_more_are_one_mistake() -> None:
    lines = [f"- {{id: {i}, ned: [{i}, 0, 0]}}\n" for i in range(256)]
    assert len(parse("transmitters:\n" + "".join(lines[:255]), "").transmitters) == 255
    assert mistakes("transmitters:\n" + "".join(lines)) == [
        "2:1: transmitters: a list of 256, expected a list of 1 to 255 transmitters"
    ]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"seed: 1\n# K\xc3\xa4lte \xe9t\xe9", "2:9: the byte 0xe9, expected UTF-8"),
        ("seed: 1".encode("utf-16"), "1:1: the byte 0xff, expected UTF-8"),
        (b"#" * (2**20 + 1), "1:1: more than 1 MiB, expected a scenario file"),
        (b"#" * 2**20, "1:1: an empty file, expected a mapping with transmitters"),
    ],
    ids=["latin-1", "utf-16", "too large", "just not too large"],
)
def test_bytes_that_are_not_a_scenario(tmp_path: Path, data: bytes, expected: str) -> None:
    path = tmp_path / "f.yaml"
    path.write_bytes(data)
    with pytest.raises(ScenarioError) as caught:
        load(path)
    assert str(caught.value) == f"{path}:{expected}"


def refusal(path: str | Path) -> str:
    with pytest.raises(ScenarioError) as caught:
        load(path)
    return str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    missing, loop = tmp_path / "missing.yaml", tmp_path / "loop.yaml"
    loop.symlink_to(loop)
    assert refusal(missing) == f"{missing}:1:1: No such file or directory, expected a scenario file"
    assert refusal(tmp_path) == f"{tmp_path}:1:1: Is a directory, expected a scenario file"
    assert refusal(loop) == f"{loop}:1:1: Too many levels of symbolic links, expected a scenario file"
    assert refusal("a\0b") == "a\0b:1:1: embedded null byte, expected a scenario file"


def test_a_file_without_permission(ordinary: Callable[[], AbstractContextManager[None]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        path = Path(folder, "f.yaml")
        path.write_text(ONE)
        assert load(path)
        path.chmod(0)
        with ordinary():
            assert refusal(path) == f"{path}:1:1: Permission denied, expected a scenario file"


def test_the_error_survives_pickling() -> None:
    with pytest.raises(ScenarioError) as caught:
        parse("seed: x", "f.yaml")
    assert pickle.loads(pickle.dumps(caught.value)).problems == caught.value.problems


@pytest.mark.parametrize("positions", [{}, {"ned": (0.0, 0.0, 0.0), "lla": Lla(0.0, 0.0, 0.0)}])
def test_a_transmitter_has_one_position(positions: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="either ned or lla"):
        Transmitter(1, **positions)  # type: ignore[arg-type]


# Whatever the text, a scenario or a ScenarioError

DEFAULT_TEXT = (CONFIGS / "default.yaml").read_text()
yaml_like = st.lists(
    st.sampled_from([*"\n\t -?:,[]{}#&*!|>'\"%@`~\\=<.01xa\r\x85", "  ", "- ", ": ", "---\n"])
    | st.sampled_from(["...", "<<", "!!", "\\x", *DEFAULT_TEXT.split()]),
    max_size=40,
).map("".join)


def scenario_or_error(text: str) -> None:
    """Anything but a ScenarioError fails the test; so does a message without a place in the text."""
    try:
        parse(text, "f.yaml")
        return
    except ScenarioError as caught:
        error = caught
    last = len(text.splitlines()) + 1
    assert error.problems
    assert str(error).count("\n") == len(error.problems) - 1
    assert all(1 <= problem.line <= last and problem.column >= 1 for problem in error.problems)


@given(st.text() | yaml_like)
@settings(max_examples=60)
@example("%YAML 1." + "9" * 5000 + "\n---\na")
@example('"\\U00110000"')
@example("&a [*a]")
def test_any_text_is_a_scenario_or_a_scenario_error(text: str) -> None:
    scenario_or_error(text)


@given(st.integers(0, len(DEFAULT_TEXT)), st.integers(0, 20), yaml_like)
@settings(max_examples=40)
def test_so_is_the_default_with_any_piece_replaced(at: int, cut: int, piece: str) -> None:
    scenario_or_error(DEFAULT_TEXT[:at] + piece + DEFAULT_TEXT[at + cut :])
