"""Spec 2: several vehicles and receivers, transmitters that move, an estimate that errs. Mistakes: tests/broken."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arva_hil.cli.main import main
from arva_hil.config import (
    DEFAULT,
    Fault,
    Follows,
    Lla,
    MountOptions,
    NavigationError,
    Noise,
    ReceiverConfig,
    ReceiverOptions,
    Scenario,
    Transmitter,
    VehicleConfig,
    load,
    newer_keys,
    parse,
    to_dict,
)
from arva_hil.config import (
    Path as Waypoints,
)
from arva_hil.registry import FORMATS, MAVLINK_FORMATS
from tests.every import every

CONFIGS = Path(__file__).parent.parent.parent / "configs"
ONE = "spec: 2\ntransmitters: [{id: 1, ned: [1, 2, 3]}]\n"


def receivers(text: str) -> list[ReceiverConfig]:
    """All receivers of a scenario with these lines."""
    return [receiver for vehicle in parse(ONE + text, "f.yaml").vehicles for receiver in vehicle.receivers]


def test_the_example_is_read_as_written() -> None:
    scenario = load(CONFIGS / "two_vehicles.yaml")
    assert scenario == Scenario(
        transmitters=(
            Transmitter(1, ned=(5.0, 20.0, 0.0)),
            Transmitter(2, path=Waypoints(((0.0, 0.0, 10.0, 0.0), (60.0, 0.0, 40.0, 0.0)), end="stay")),
            Transmitter(3, follows=Follows(2, (0.0, 0.0, 1.0))),
        ),
        navigation_error=NavigationError(
            (0.5, 0.0, 0.0), walk_sigma_m=1.5, walk_tau_s=60.0, heading_deg=2.0, latency_s=0.1
        ),
        vehicles=(
            VehicleConfig(
                "alpha",
                "udpin:127.0.0.1:14550",
                1,
                receivers=(
                    ReceiverConfig(
                        "front",
                        "pty:/tmp/alpha-front",
                        ReceiverOptions(mount=MountOptions((0.3, 0.0, 0.0))),
                        "binary",
                        1,
                    ),
                    ReceiverConfig("rear", "pty:/tmp/alpha-rear", ReceiverOptions(rate_hz=5.0), "nmea", 7),
                ),
            ),
            VehicleConfig(
                "bravo",
                "udpin:127.0.0.1:14550",
                2,
                receivers=(ReceiverConfig("only", "pty:/tmp/bravo", ReceiverOptions(), "binary", 3),),
            ),
        ),
    )


def test_a_file_of_spec_1_has_nothing_of_it() -> None:
    scenario = load(CONFIGS / "default.yaml")
    assert not newer_keys(scenario)
    assert (scenario.pose, scenario.navigation_error, scenario.vehicles) == ("estimate", None, ())
    assert to_dict(scenario)["spec"] == 1


def test_a_file_of_spec_2_that_has_nothing_of_it_is_the_same_scenario() -> None:
    assert parse(ONE, "f.yaml") == parse(ONE.replace("spec: 2", "spec: 1"), "f.yaml")


def test_a_receiver_has_the_keys_of_the_scenarios_receiver_unless_it_has_its_own() -> None:
    front, rear = receivers(
        "receiver: {channels: 2, rate_hz: 5, noise: {kind: off}, mount: {position: [1, 0, 0]}}\n"
        "output: {format: text}\n"
        "vehicles:\n"
        "- name: a\n"
        "  receivers:\n"
        "  - {name: front, port: pty:p, rate_hz: 10}\n"
        "  - {name: rear, port: pty:q, format: nmea, mount: {attitude: {yaw: 180}}}\n"
    )
    common = ReceiverOptions(channels=2, rate_hz=5.0, noise=Noise("off"), mount=MountOptions((1.0, 0.0, 0.0)))
    assert (front.receiver, front.output_format) == (replace(common, rate_hz=10.0), "text")
    assert (rear.receiver, rear.output_format) == (
        replace(common, mount=MountOptions(attitude=(0.0, 0.0, 180.0))),
        "nmea",
    )


def test_receivers_without_a_seed_have_different_ones_that_follow_the_scenarios() -> None:
    vehicles = (
        "vehicles:\n"
        "- {name: a, system: 1, receivers: [{name: x, port: pty:p}, {name: y, port: pty:q, seed: 40}]}\n"
        "- {name: b, system: 2, receivers: [{name: x, port: pty:r}]}\n"
    )
    assert [receiver.seed for receiver in receivers(vehicles)] == [1, 40, 3]
    assert [receiver.seed for receiver in receivers("seed: 9223372036854775807\n" + vehicles)] == [2**63 - 1, 40, 1]


def test_a_receiver_over_the_autopilots_link_needs_no_port() -> None:
    (receiver,) = receivers("vehicles: [{name: a, receivers: [{name: x, format: tunnel}]}]")
    assert (receiver.port, receiver.output_format) == (None, "tunnel")


def test_vehicles_on_links_of_their_own_need_no_system_and_every_pty_is_a_new_one() -> None:
    vehicle = '- {{name: {0}, autopilot: "pty:{0}", receivers: [{{name: r, port: pty}}]}}\n'
    scenario = parse(ONE + "vehicles:\n" + vehicle.format("a") + vehicle.format("b"), "f.yaml")
    assert [vehicle.system for vehicle in scenario.vehicles] == [None, None]


def test_a_path_in_enu_is_the_same_path_in_ned() -> None:
    places = []
    enu = "frame: enu, points: [[0, 1, 2, 3], [1.5, 4, 5, -6]]"
    ned = "frame: ned, points: [[0, 2, 1, -3], [1.5, 5, 4, 6]]"
    for path in (enu, ned):
        (transmitter,) = parse(f"spec: 2\ntransmitters: [{{id: 1, path: {{{path}}}}}]", "f.yaml").transmitters
        places.append(transmitter.path)
    assert places[0] == places[1] == Waypoints(((0.0, 2.0, 1.0, -3.0), (1.5, 5.0, 4.0, 6.0)), end="stay")


# In Python


@every(
    "make, why",
    [
        (
            lambda: ReceiverOptions(rate_hz=0),
            "ReceiverOptions rate_hz: 0, expected a number from 0.1 to 50",
        ),
        (
            lambda: ReceiverOptions(rate_hz=10, jitter_s=0.05),
            "ReceiverOptions jitter_s: jitter_s 0.05, expected less than half the period (0.05 s)",
        ),
        (
            lambda: ReceiverOptions(sensitivity=(1, 1)),  # type: ignore[arg-type]
            "ReceiverOptions sensitivity: 2 numbers, expected 3 (x, y, z)",
        ),
        (
            lambda: ReceiverOptions(model="none"),
            "ReceiverOptions model: 'none', expected one of paper, ",
        ),
        (
            lambda: ReceiverOptions(no_signal=(0, -1)),
            "ReceiverOptions no_signal: [0, -1], expected [-1, -1], [-1, 0] or [0, 0]",
        ),
        (
            lambda: replace(ReceiverOptions(), channels=True),
            "ReceiverOptions channels: True, expected a whole number from 1 to 16",
        ),
        (
            lambda: Noise("white"),  # type: ignore[arg-type]
            "Noise kind: 'white', expected one of uniform, gaussian, off",
        ),
        (
            lambda: Noise(floor_range_m=float("nan")),
            "Noise floor_range_m: nan, expected a number from 0.01 to 1000000",
        ),
        (
            lambda: MountOptions((0, 0, 1000)),
            "MountOptions position[2]: 1000, expected a number from -100 to 100",
        ),
        (
            lambda: Lla(91, 0, 0),
            "Lla lat: 91, expected a latitude from -90 to 90",
        ),
        (
            lambda: Transmitter(255, ned=(0, 0, 0)),
            "Transmitter id: 255, expected a whole number from 0 to 254",
        ),
        (
            lambda: Transmitter(1),
            "a transmitter has either ned or lla, path or follows",
        ),
        (
            lambda: Transmitter(1, ned=(0, 0, 0), follows=Follows(1)),
            "a transmitter has either ned or lla, path or follows",
        ),
        (
            lambda: Transmitter(1, ned=(0, 0, 0), enu=(0, 0, 0)),
            "a transmitter has either ned or lla, path or follows",
        ),
        (
            lambda: Waypoints(()),
            "a path has at least one point",
        ),
        (
            lambda: Waypoints(((1, 0, 0, 0), (1, 0, 0, 0))),
            "Path points_ned[1]: a point at 1 s, expected later than the point before (1 s)",
        ),
        (
            lambda: Follows(0),
            "Follows system: 0, expected a whole number from 1 to 255",
        ),
        (
            lambda: NavigationError(latency_s=-1),
            "NavigationError latency_s: -1, expected a number from 0 to 10",
        ),
        (
            lambda: Fault("drop", 2),
            "Fault value: 2, expected a probability above 0, at most 1",
        ),
        (
            lambda: Fault("drap", 0.5),
            "Fault name: 'drap', expected one of transmitter_off, transmitter_moved, ",
        ),
        (
            lambda: Fault("transmitter_moved", 1),
            "Fault transmitter_moved without by_ned, expected a fault with by_ned",
        ),
        (
            lambda: Fault("drop", 0.5, from_s=5, until_s=5),
            "Fault until_s: until_s 5, expected later than from_s (5)",
        ),
        (
            lambda: ReceiverConfig("a", None),
            "receiver a has no port and the format binary",
        ),
        (
            lambda: ReceiverConfig("a", "pty", output_format="tunnel"),
            "receiver a has a port and the format tunnel",
        ),
        (
            lambda: ReceiverConfig("../a", "pty"),
            "ReceiverConfig name: '../a', expected a name of letters, digits, _, - and .",
        ),
        (
            lambda: VehicleConfig("a", system=0, receivers=()),
            "VehicleConfig system: 0, expected a whole number from 1 to 255",
        ),
        (
            lambda: replace(DEFAULT, transmitters=DEFAULT.transmitters * 2),
            "Scenario transmitters[1].id: id 1 again, expected an id of its own",
        ),
        (
            lambda: replace(DEFAULT, seed=-1),
            "Scenario seed: -1, expected a whole number from 0 to 9223372036854775807",
        ),
        (
            lambda: replace(DEFAULT, output_format="json"),  # type: ignore[arg-type]
            "Scenario output_format: 'json', expected one of binary, nmea, text, handheld, vector, rssi, tunnel, ",
        ),
        (
            lambda: replace(DEFAULT, pose="guess"),  # type: ignore[arg-type]
            "Scenario pose: 'guess', expected one of estimate, truth",
        ),
        (
            lambda: replace(DEFAULT, vehicles=(VehicleConfig("a", receivers=()),) * 2),
            "Scenario vehicles[1].name: vehicle a again, expected a name of its own; vehicles[0]: no system, ",
        ),
    ],
)
def test_wrong_values_are_refused_in_python_too(make: Callable[[], Any], why: str) -> None:
    with pytest.raises(ValueError, match=re.escape(why)):
        make()


def test_a_misspelt_argument_is_refused_as_python_does() -> None:
    with pytest.raises(TypeError, match="chanels"):
        ReceiverOptions(chanels=3)  # type: ignore[call-arg]


def test_what_is_wrong_is_named_with_its_value() -> None:
    with pytest.raises(ValueError, match=r"^ReceiverOptions rate_hz: 99, expected a number from 0.1 to 50$"):
        ReceiverOptions(rate_hz=99)


def test_numbers_of_python_become_those_of_a_file() -> None:
    assert repr(Transmitter(1, (1, 2, 3)).ned) == "(1.0, 2.0, 3.0)"
    assert Transmitter(1, enu=(1, 2, 3)) == Transmitter(1, (2.0, 1.0, -3.0))


def test_a_scenario_cannot_be_changed() -> None:
    for thing, name in [(DEFAULT, "seed"), (DEFAULT.receiver, "rate_hz"), (DEFAULT.transmitters[0], "id")]:
        with pytest.raises(AttributeError):
            setattr(thing, name, 5)


# Round trip

triples = st.tuples(*[st.floats(-100, 100)] * 3)
names = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,8}", fullmatch=True)
paths = st.lists(st.tuples(st.floats(0, 1e6), *[st.floats(-1e6, 1e6)] * 3), min_size=1, unique_by=lambda p: p[0]).map(
    lambda points: tuple(sorted(points))
)
ids = st.integers(0, 254)
moving = st.one_of(
    st.builds(
        Transmitter, id=st.integers(0, 254), path=st.builds(Waypoints, paths, end=st.sampled_from(["stay", "loop"]))
    ),
    st.builds(
        Transmitter, id=st.integers(0, 254), follows=st.builds(Follows, system=st.integers(1, 255), offset=triples)
    ),
)
errors = st.builds(
    NavigationError,
    bias_ned=triples,
    walk_sigma_m=st.floats(0, 1000),
    walk_tau_s=st.floats(0, 1e6, exclude_min=True),
    heading_deg=st.floats(-180, 180),
    latency_s=st.floats(0, 10),
)


@st.composite
def fleets(draw: st.DrawFn) -> tuple[VehicleConfig, ...]:
    vehicles = []
    for system, name in enumerate(draw(st.lists(names, max_size=3, unique=True)), 1):
        each = []
        for of in draw(st.lists(names, min_size=1, max_size=3, unique=True)):
            output_format = draw(st.sampled_from(list(FORMATS)))
            port = f"pty:/tmp/{name}/{of}" if output_format not in MAVLINK_FORMATS else None
            receiver = draw(
                st.builds(ReceiverOptions, channels=st.integers(1, 16), mount=st.builds(MountOptions, triples, triples))
            )
            each.append(ReceiverConfig(of, port, receiver, output_format, draw(st.integers(0, 2**63 - 1))))
        vehicles.append(
            VehicleConfig(name, draw(st.none() | st.just("udpin:127.0.0.1:14550")), system, receivers=tuple(each))
        )
    return tuple(vehicles)


@given(
    st.builds(
        Scenario,
        transmitters=st.lists(moving, min_size=1, max_size=4, unique_by=lambda t: t.id).map(tuple),
        pose=st.just("estimate"),
        navigation_error=st.none() | errors,
        vehicles=fleets(),
    )
    | st.builds(Scenario, transmitters=st.just(DEFAULT.transmitters), pose=st.just("truth"))
)
@settings(deadline=None)
def test_written_and_read_back_it_is_equal(scenario: Scenario) -> None:
    plain = to_dict(scenario)
    assert json.loads(json.dumps(plain)) == plain  # JSON types only
    assert parse(json.dumps(plain), "f.yaml") == scenario


def test_a_command_that_does_not_serve_a_part_of_it_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--scenario", str(CONFIGS / "two_vehicles.yaml")]) == 2
    assert "navigation_error: the demo does not support it" in capsys.readouterr().err
