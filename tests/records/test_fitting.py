"""Fits: the truth that was rehearsed lies in the intervals; what a flight cannot tell, and what is wrong, is said."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arva_hil.config import DEFAULT, Scenario, Transmitter, VehicleNoiseOptions, parse
from arva_hil.config.profiles import parse_profile
from arva_hil.config.receiver import Noise, ReceiverOptions
from arva_hil.model.field import LocalFrame
from arva_hil.records.fitting import FitError, FittedValue, ReceiverFit, flight_of, start
from arva_hil.records.fitting.fit import fit
from arva_hil.records.fitting.noise_levels import noise_levels, noise_profile
from arva_hil.records.fitting.profile import profile, scenario
from arva_hil.records.fitting.scatter import Gps
from arva_hil.records.reading import Recording, RecordingError, load
from tests.once import once
from tests.said import says
from tools.figures.rehearsal import HOME, Waypoint, drawn, misses, mission, rehearse

GPS = Gps(1.5, 60.0)
EXACT = Gps(0.05, 60.0)
SHORT = mission(20.0, 5.0, 4.0)[:15]


@pytest.fixture(scope="module", autouse=True)
def few_starts() -> Iterator[None]:
    """The best two of the places from which a fit begins: each one more takes as long again."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(start, "_KEEP", 2)
        yield


def fitted(folder: Path, gps: Gps, model: str = "paper") -> ReceiverFit:
    return fit([flight_of(load(folder))], model, gps)


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Scenario, dict[str, float]]:
    """A flight without an error of GPS."""
    chosen, truth = drawn(1)
    chosen = replace(chosen, navigation_error=None)
    folder = once(
        tmp_path_factory,
        "fit-exact",
        lambda made: rehearse(made / "r", chosen, SHORT, latency_s=truth["latency"], wind=0.0),
    )
    return folder / "r", chosen, truth


@pytest.fixture(scope="module")
def of_exact(exact: tuple[Path, Scenario, dict[str, float]]) -> ReceiverFit:
    return fitted(exact[0], EXACT)


def test_without_an_error_of_gps_each_parameter_is_found_closely(
    exact: tuple[Path, Scenario, dict[str, float]], of_exact: ReceiverFit
) -> None:
    truth, get = exact[2], of_exact.estimates
    assert get["kappa_eq"].value == pytest.approx(truth["kappa_eq"], rel=0.02)
    assert get["latency"].value == pytest.approx(truth["latency"], abs=0.02)
    assert get["mount yaw"].value == pytest.approx(truth["mount yaw"], abs=0.5)
    assert get["transmitter 1 north"].value == pytest.approx(truth["transmitter 1 north"], abs=0.1)
    assert get["transmitter 1 pitch"].value == pytest.approx(truth["transmitter 1 pitch"], abs=1.0)
    assert get["floor_range_m"].value == pytest.approx(truth["floor_range_m"], rel=0.15)
    assert of_exact.doubts == []


def test_what_the_flight_cannot_tell_is_named_with_the_next_pass(of_exact: ReceiverFit) -> None:
    names = [one.name for one in of_exact.estimates.values() if not one.identified]
    says(names, "mount z", "sensitivity z")
    assert of_exact.estimates["mount z"].like == "transmitter 1 down"
    assert any("does not determine mount z, not from transmitter 1 down" in one for one in of_exact.advice)


def test_the_profile_and_the_scenario_can_be_read(
    exact: tuple[Path, Scenario, dict[str, float]], of_exact: ReceiverFit, tmp_path: Path
) -> None:
    text = profile(of_exact, ["2027-01-01T00:00:00.000Z"])
    says(text, "# record r, 2027-01-01", "residuals of", "not determined by the flight")
    parse_profile(text, "receiver", "p.yaml")
    (tmp_path / "p.yaml").write_text(text)
    (tmp_path / "s.yaml").write_text(scenario(of_exact, "p.yaml"))
    from arva_hil.config import load as load_scenario

    again = load_scenario(tmp_path / "s.yaml")
    assert again.receiver.kappa_eq == pytest.approx(exact[2]["kappa_eq"], rel=0.02)
    assert again.transmitters[0].ned == pytest.approx(exact[1].transmitters[0].ned, abs=1.5)


def test_a_latency_of_zero_is_no_fault_of_the_scenario(of_exact: ReceiverFit) -> None:
    estimates = {**of_exact.estimates, "latency": replace(of_exact.estimates["latency"], value=0.0004)}
    assert parse(scenario(replace(of_exact, estimates=estimates), "builtin:paper"), "s.yaml").faults == ()


def test_the_age_of_pulses_is_not_a_delay(of_exact: ReceiverFit) -> None:
    estimates = {**of_exact.estimates, "latency": replace(of_exact.estimates["latency"], value=0.9)}
    (late,) = parse(scenario(replace(of_exact, model="pulsed", estimates=estimates), "builtin:paper"), "s.yaml").faults
    assert late.value == pytest.approx(0.4)


@pytest.mark.parametrize(("model", "seed"), [("pulsed", 31), ("rssi", 42)])
def test_receivers_of_pulses_are_fitted(model: str, seed: int, tmp_path: Path) -> None:
    chosen, truth = drawn(seed, model)
    chosen = replace(chosen, navigation_error=None, output_format="rssi" if model == "rssi" else "binary")
    found = fitted(rehearse(tmp_path / "r", chosen, SHORT[:9], latency_s=truth["latency"]), EXACT, model)
    assert found.doubts == []
    for name in "kappa_eq", "mount x", "mount y", "mount yaw":
        one = found.estimates[name]
        assert abs(truth[name] - one.value) <= one.high - one.low, name
    assert found.estimates["kappa_eq"].value == pytest.approx(truth["kappa_eq"], rel=0.1)
    parse_profile(profile(found, [""]), "receiver", "p.yaml")


def test_the_truth_lies_in_the_intervals_of_several_records_with_wind_noise_and_an_error_of_gps(tmp_path: Path) -> None:
    chosen, truth = drawn(32)
    second = [point._replace(time_s=point.time_s - SHORT[7].time_s) for point in SHORT[7:]]
    flights = [
        flight_of(load(rehearse(tmp_path / str(seed), replace(chosen, seed=seed), points, latency_s=truth["latency"])))
        for seed, points in enumerate([SHORT[:8], second])
    ]
    far = np.abs(list(misses(fit(flights, "paper", GPS).estimates, truth).values()))
    assert len(far) >= 8
    assert np.mean(far <= 1) >= 0.8, far
    assert far.max() < 2, far


def test_outliers_count_little(exact: tuple[Path, Scenario, dict[str, float]], of_exact: ReceiverFit) -> None:
    flight = flight_of(load(exact[0]))
    d_m = flight.d_m.copy()
    d_m[5::12] *= 1.8
    found = fit([replace(flight, d_m=d_m)], "paper", EXACT)
    assert found.outliers >= 0.8 * len(d_m[5::12])
    assert found.estimates["kappa_eq"].value == pytest.approx(of_exact.estimates["kappa_eq"].value, rel=0.03)


def test_a_dipole_whose_axis_is_reversed_is_not_a_miss() -> None:
    names = "transmitter 1 yaw", "transmitter 1 pitch"
    estimates = {
        name: FittedValue(name, "°", value, value - 1, value + 1, True)
        for name, value in zip(names, (-89.8, 28.0), strict=True)
    }
    assert misses(estimates, dict(zip(names, (89.9, -28.5), strict=True))) == pytest.approx(
        dict(zip(names, (-0.3, 0.5), strict=True))
    )


def test_a_receiver_of_pulses_is_no_receiver_of_the_paper(tmp_path: Path) -> None:
    chosen, _ = drawn(4, "pulsed")
    found = fitted(rehearse(tmp_path / "r", replace(chosen, navigation_error=None), SHORT[:9]), EXACT)
    (doubt,) = found.doubts
    assert "the model paper does not fit: d comes in steps of 1 m" in doubt
    assert doubt.endswith("Try --model pulsed")
    assert "# doubt: the model paper does not fit" in profile(found, [""])


def test_a_surveyed_place_100_m_off_is_said(tmp_path: Path) -> None:
    chosen, truth = drawn(5)
    wrong = LocalFrame(*HOME).lla([truth["transmitter 1 north"] + 100, truth["transmitter 1 east"], 0.0])
    lat, lon, alt = (float(value) for value in wrong)
    folder = rehearse(tmp_path / "r", replace(chosen, navigation_error=None), SHORT[:9], surveyed=[(1, lat, lon, alt)])
    (doubt,) = [one for one in fitted(folder, EXACT).doubts if "surveyed place" in one]
    assert 80 < float(doubt.split("about ")[1].split(" m")[0]) < 115


def test_what_cannot_be_fitted_is_said(exact: tuple[Path, Scenario, dict[str, float]]) -> None:
    whole = load(exact[0])
    (receiver,) = whole.receivers
    for receivers, why in (
        ((receiver, receiver), "expected a record of one receiver, found 2"),
        ((), "expected a record of one receiver, found 0"),
        ((replace(receiver, time_s=receiver.time_s + 9e3),), "the autopilot's packets do not cover the readings"),
    ):
        with pytest.raises(FitError, match=why):
            flight_of(replace(whole, receivers=receivers))
    with pytest.raises(RecordingError, match="came more than a day after the frames"):
        flight_of(replace(whole, log_start_s=whole.log_start_s - 1e9))
    flight = flight_of(whole)
    with pytest.raises(FitError, match=r"different transmitters \(.*: 1; .*: 7\): fit them one by one"):
        fit([flight, replace(flight, ids=(7,))], "paper", EXACT)


def test_what_a_record_lacks_is_said(tmp_path: Path) -> None:
    chosen, _ = drawn(1)
    hover = [Waypoint(0, 10, 0, -4, 0), Waypoint(12, 12, 0, -4, 0)]
    with pytest.raises(FitError, match=r"too short: 1[0-9] readings with a pose, at least 25 are needed"):
        flight_of(load(rehearse(tmp_path / "short", chosen, hover)))
    far = replace(chosen, transmitters=(Transmitter(id=1, ned=(900.0, 0.0, 0.0)),))
    with pytest.raises(FitError, match="no frame contains a transmitter"):
        flight_of(load(rehearse(tmp_path / "far", far, hover)))
    with pytest.raises(FitError, match="no fit for the model 'morse'"):
        fit([], "morse", GPS)


# -- noise over the load of the motors, from a record on the ground: the levels are those that were rehearsed --


LEVELS = ((0.0, 0.0), (0.5, 5.0), (1.0, 10.0))


def record(
    folder: Path, throttle: Callable[[float], float] | None, steps: str = "cm", seconds: float = 120
) -> Recording:
    """Return the record of a vehicle that stands 20 m from the transmitter."""
    pulsed = {"start_s": 0.0, "steps": steps, "noise_na_m": 1.0}
    noise = VehicleNoiseOptions(levels=LEVELS)
    receiver = ReceiverOptions(model="pulsed", options=pulsed, vehicle_noise=noise, noise=Noise("gaussian"))
    stands = [Waypoint(0, 0, 5, 0, 0), Waypoint(seconds, 0, 5, 0, 0)]
    scenario = replace(DEFAULT, receiver=receiver)
    return load(rehearse(folder / "r", scenario, stands, wind=0.0, throttle=throttle))


def test_the_levels_are_those_of_the_vehicle(tmp_path: Path) -> None:
    ground = record(tmp_path, lambda t: 0.0 if t < 60 else 0.5)
    (off, quiet), (on, loud) = noise_levels(ground)
    assert (off, quiet) == (pytest.approx(0, abs=0.02), 0)
    assert on == pytest.approx(0.5, abs=0.03)
    assert loud == pytest.approx(5.0, rel=0.3)
    parse_profile(noise_profile(ground, [(off, quiet), (on, loud)]), "receiver", "noise.yaml")


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    with pytest.raises(FitError, match="the autopilot has sent no load of its motors"):
        noise_levels(record(tmp_path / "a", None, seconds=45))
    with pytest.raises(FitError, match="had 1 loads with 20 readings or more, two are needed"):
        noise_levels(record(tmp_path / "b", lambda t: 0.5, seconds=45))
    with pytest.raises(FitError, match="its steps hide the noise\\. Put the transmitter farther away"):
        noise_levels(record(tmp_path / "c", lambda t: 0.0 if t < 30 else 0.5, "digits", seconds=60))
