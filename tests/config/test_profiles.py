"""Profiles: files whose keys transmitters and receivers take over; when transmitters send; what lies between."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from arva_hil.cli.main import main
from arva_hil.config import KeyingOptions, MediumOptions, Scenario, ScenarioError, Transmitter, load, parse, to_dict
from arva_hil.config.profiles import builtin_files
from arva_hil.config.transmitter import KeyingKind
from arva_hil.emulator.build import outside_norm, receiver, transmitters
from arva_hil.model.field import LocalFrame
from arva_hil.model.field.keying import KEYING_CLASSES
from arva_hil.model.receiver.pulsed import PulsedReceiver, VectorReceiver
from tests.every import every

DATUM = LocalFrame(46.0, 7.0, 1650.0)
PROFILES = [name for name in builtin_files() if name.startswith(("receivers/", "transmitters/"))]


def scenario(text: str, source: str = "s.yaml") -> Scenario:
    return parse(f"spec: 2\n{text}", source)


def problems(text: str, source: str = "s.yaml") -> list[str]:
    with pytest.raises(ScenarioError) as error:
        scenario(text, source)
    return list(map(str, error.value.problems))


@every("name", PROFILES)
def test_every_profile_is_a_scenario_s_and_gives_every_number_a_source_or_says_assumption(name: str) -> None:
    folder, own = name.split("/")
    if folder == "receivers":
        made = receiver(scenario(f"transmitters: [{{id: 1, ned: [1, 2, 3]}}]\nreceiver: {{profile: 'builtin:{own}'}}"))
        assert made.show(0.0).channels
    else:
        there = transmitters(scenario(f"transmitters: [{{id: 1, ned: [1, 2, 3], profile: 'builtin:{own}'}}]"), DATUM)
        assert there.keyings[0].period_s > 0.5
    lines = builtin_files()[name].read_text(encoding="utf-8").splitlines()
    numbers = [
        line for line in lines if any(c.isdigit() for c in line.partition("#")[0]) and not line.startswith("spec")
    ]
    words = "assumption", "[S", "arithmetic", "paper", "wire", "by definition", "norm", "as three_antennas"
    assert [line for line in numbers if not any(word in line.partition("#")[2] for word in words)] == []


def test_a_receiver_takes_over_what_it_has_not_of_its_own() -> None:
    keys = "profile: 'builtin:three_antennas', lowest_m: 0.2, rate_hz: 4"
    text = f"transmitters: [{{id: 1, ned: [1, 2, 3]}}]\nreceiver: {{{keys}}}"
    options = scenario(text).receiver
    assert (options.model, options.rate_hz, options.channels) == ("pulsed", 4.0, 4)
    assert (options.options.lowest_m, options.options.revert_s) == (0.2, 480.0)
    assert isinstance(receiver(scenario(text)), PulsedReceiver)


def test_receivers_of_vehicles_have_profiles_of_their_own() -> None:
    fleet = scenario(
        "transmitters: [{id: 1, ned: [1, 2, 3]}]\nreceiver: {profile: 'builtin:paper', rate_hz: 2}\n"
        "vehicles: [{name: a, receivers: [{name: front, port: pty}, "
        "{name: rear, port: pty, profile: 'builtin:estimator'}]}]"
    )
    front, rear = (one.receiver for one in fleet.vehicles[0].receivers)
    assert (front.model, front.options.threshold_na_m, front.rate_hz) == ("pulsed", 6.168, 2.0)
    assert (rear.model, rear.channels, rear.rate_hz) == ("vector", 16, 2.0)
    assert VectorReceiver.from_settings(rear, 1)


def test_a_transmitter_of_a_profile_has_its_own_strength_and_place() -> None:
    chosen = scenario("transmitters: [{id: 3, ned: [1, 2, 3], profile: 'builtin:weak', strength: 0.9}]")
    assert chosen.transmitters == (
        Transmitter(3, ned=(1.0, 2.0, 3.0), strength=0.9, keying=KeyingOptions("norm-weak")),
    )
    assert transmitters(chosen, DATUM).strengths.tolist() == [0.45]


def test_a_profile_is_looked_for_beside_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("spec: 2\nreceiver: {model: pulsed, antennas: 2}\n")
    (tmp_path / "s.yaml").write_text(
        "spec: 2\ntransmitters: [{id: 1, ned: [1, 2, 3]}]\nreceiver: {profile: mine.yaml}\n"
    )
    assert load(tmp_path / "s.yaml").receiver.options.antennas == 2


def test_mistakes_in_a_profile_are_said_where_they_are_with_those_of_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("spec: 2\nreceiver: {model: pulsed, antenas: 2}\n")
    source = str(tmp_path / "s.yaml")
    first, second = problems("transmitters: [{id: 1, nde: [1, 2, 3]}]\nreceiver: {profile: mine.yaml}", source)[:2]
    assert first.startswith(f"{tmp_path}/mine.yaml:2:27: unknown key 'antenas'")
    assert second.startswith(f"{source}:2:")


def test_what_does_not_fit_together_is_said_at_the_profile_s_name(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("spec: 2\n\n\n\n\nreceiver: {rate_hz: 10}\n")
    text = "transmitters: [{id: 1, ned: [1, 2, 3]}]\nreceiver: {profile: mine.yaml, jitter_s: 0.06}"
    (only,) = problems(text, str(tmp_path / "s.yaml"))
    assert only.startswith(f"{tmp_path}/s.yaml:3:")


@every(
    "text, words",
    [
        (
            "receiver: {profile: 'builtin:nothing'}",
            "no receiver profile 'builtin:nothing', expected one of builtin:deafened, ",
        ),
        ("receiver: {profile: nothing.yaml}", "no receiver profile 'nothing.yaml', expected a file, or one of "),
        (r'receiver: {profile: "a\0/b.yaml"}', r"no receiver profile 'a\x00/b.yaml', expected a file, or one of "),
        (r'receiver: {profile: "a\ud800/b"}', r"no receiver profile 'a\ud800/b', expected a file, or one of "),
        ("receiver: {profile: [a]}", "expected the name of a profile"),
        ("medium: {dipole: round}", "expected one of static, full"),
        ("medium: {snow_conductivity_s_m: -1}", "expected a number from 0 to 10"),
        ("receiver: {vehicle_noise: {motors: []}}", "expected a list of 1 to 16 places"),
        ("receiver: {vehicle_noise: {motor_na_m: 3}}", "neither, expected motors, or levels"),
        ("receiver: {model: rssi, revert_s: 60}", "revert_s 60, expected model: pulsed or vector, which have it"),
        ("receiver: {model: rssi, lag_s: 2}", "lag_s 2, expected model: pulsed or vector, which have it"),
        ("receiver: {model: rssi, start_s: -1}", "start_s: '-1', expected greater than or equal to 0"),
        ("receiver: {model: vector, start_s: -1}", "start_s: '-1', expected greater than or equal to 0"),
        ("receiver: {model: rssi, self_test_m: 5}", "self_test_m 5, expected model: pulsed or vector, which have it"),
        ("receiver: {model: rssi, full_scale_na_m: 1e999}", "expected a finite number"),
        ("receiver: {model: pulsed, third_within_m: 1e150}", "expected less than or equal to 1000"),
        ("receiver: {model: pulsed, saturation_na_m: 1}", "saturation_na_m 1, expected above threshold_na_m (2.25)"),
    ],
)
def test_what_is_wrong_is_said(text: str, words: str) -> None:
    assert any(words in one for one in problems(f"transmitters: [{{id: 1, ned: [1, 2, 3]}}]\n{text}"))


@every(
    "keying, words",
    [
        (
            "{kind: analogue, period_s: 0.15}",
            "2:75: a pulse of 0.2 s in a period of 0.15 s, expected a period above the pulse",
        ),
        ("{pulse_s: 0.9}", "2:58: a pulse of 0.9 s in a period of 0.7 s, expected a period above the pulse"),
        ("{period_s: 1, pulse_s: 1}", "a pulse of 1 s in a period of 1 s"),
        ("{kind: analogue, pulse_s: 0.85}", "2:74: a pulse of 0.85 s in a period of 0.812 s"),
        (
            "{jitter_s: 0.06}",
            "2:59: a jitter of 0.06 s and a pause of 0.62 s, expected a jitter below a twelfth of the pause",
        ),
        ("{period_s: 0.082}", "2:59: a jitter of 0.0002 s and a pause of 0.002 s, expected a jitter below a twelfth"),
        ("{kind: analog}", "did you mean 'analogue'?"),
    ],
)
def test_timing_that_contradicts_itself_is_refused_with_its_place(keying: str, words: str) -> None:
    assert any(words in one for one in problems(f"transmitters: [{{id: 1, ned: [1, 2, 3], keying: {keying}}}]"))
    with pytest.raises(ValueError, match="expected a period above the pulse"):
        KeyingOptions("modern", 0.05)


def test_spec_1_has_none_of_it() -> None:
    for text in ("medium: {}", "receiver: {profile: x}", "receiver: {vehicle_noise: {motors: [[0, 0, 0]]}}"):
        with pytest.raises(ScenarioError, match="of spec 2, expected `spec: 2`"):
            parse(f"transmitters: [{{id: 1, ned: [1, 2, 3]}}]\n{text}", "s.yaml")


def test_written_and_read_back_it_is_equal() -> None:
    chosen = Scenario(
        (Transmitter(1, ned=(1.0, 2.0, 3.0), keying=KeyingOptions("analogue", 0.95, leak_db=-60.0, from_s=3.0)),),
        medium=MediumOptions("full", 1e-4, 3.0, -1.0),
    )
    assert parse(str(to_dict(chosen)).replace("'", '"'), "again") == chosen


def test_the_classes_of_a_scenario_are_those_of_the_field() -> None:
    assert list(get_args(KeyingKind)) == list(KEYING_CLASSES)


def test_what_is_given_of_a_transmitter_is_so_and_the_rest_is_drawn_by_seed_and_id() -> None:
    given = "keying: {period_s: 0.9, battery: 0.5, battery_life_h: 10}"
    text = f"transmitters: [{{id: 1, ned: [1, 2, 3], {given}}}, {{id: 2, ned: [1, 2, 3]}}]"
    one, other = (transmitters(scenario(f"{text}\nseed: {seed}"), DATUM).keyings for seed in (1, 2))
    assert one[0].period_s == other[0].period_s == 0.9
    assert (one[0].battery, one[0].battery_life_s) == (0.5, 36_000.0)
    assert one[0].phase_s != other[0].phase_s
    assert one[1].period_s != other[1].period_s


def test_the_medium_reaches_every_receiver() -> None:
    chosen = scenario(
        "transmitters: [{id: 1, ned: [0, 0, 2]}]\nmedium: {snow_conductivity_s_m: 1.0e-2, snow_permittivity: 15}"
    )
    there, plain = transmitters(chosen, DATUM), transmitters(scenario("transmitters: [{id: 1, ned: [0, 0, 2]}]"), DATUM)
    point = np.array([5.0, 0.0, -1.0])
    ratio = np.linalg.norm(there.field_at(point)) / np.linalg.norm(plain.field_at(point))
    assert 20 * np.log10(ratio) == pytest.approx(-8.686 * 2 / 7.588, rel=1e-3)


def test_a_set_outside_the_norm_is_a_warning_with_the_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("spec: 2\ntransmitters: [{id: 7, ned: [1, 2, 3], strength: 3, keying: {period_s: 0.4}}]\n")
    assert outside_norm(load(path)) == [
        "transmitter 7: period 0.4 s: the norm has 0.7…1.3 s",
        "transmitter 7: pause 0.32 s: the norm has at least 0.4 s",
        "transmitter 7: strength 3: the norm has 0.5…2.24 µA/m at 10 m",
    ]
    assert main(["check", str(path)]) == 0
    assert "warning: transmitter 7: period 0.4 s: the norm has 0.7…1.3 s" in capsys.readouterr().err


def test_a_profile_outside_the_norm_is_a_warning_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    deaf, weak, strong = tmp_path / "deaf.yaml", tmp_path / "weak.yaml", tmp_path / "strong.yaml"
    deaf.write_text("spec: 2\nreceiver: {model: pulsed, threshold_na_m: 90, noise_na_m: 50}\n")
    weak.write_text("spec: 2\ntransmitter: {strength: 0.3, keying: {kind: modern, period_s: 1}}\n")
    strong.write_text("spec: 2\ntransmitter: {strength: 5}\n")
    assert main(["check", str(deaf), str(weak), str(strong)]) == 0
    told = capsys.readouterr().err.splitlines()
    assert told == [
        f"{deaf}: warning: threshold_na_m 90: the norm has at most 80 nA/m",
        f"{deaf}: warning: noise_na_m 50: the norm has at most 46 nA/m",
        f"{weak}: warning: strength 0.3: the norm has 0.5…2.24 µA/m at 10 m",
        f"{strong}: warning: strength 5: the norm has 0.5…2.24 µA/m at 10 m",
    ]


def test_a_strength_is_judged_in_the_units_of_the_receiver_that_listens_to_pulses() -> None:
    places = "transmitters: [{id: 1, ned: [1, 2, 3], strength: 2}]\nreceiver: "
    assert outside_norm(scenario(places + "{model: paper}")) == []
    assert outside_norm(scenario(places + "{model: pulsed}")) == []
    assert outside_norm(scenario(places + "{model: pulsed, reference_ua_m: 1.5}")) == [
        "transmitter 1: strength 3: the norm has 0.5…2.24 µA/m at 10 m"
    ]
