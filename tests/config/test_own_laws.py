"""Own laws in a profile: a table of the display, sensitivity by carrier, noise over the motors' load."""

from __future__ import annotations

from pathlib import Path

import pytest

from arva_hil.config import Scenario, ScenarioError, load, to_dict
from arva_hil.config.display import parse_law
from arva_hil.emulator.build import receiver, transmitters, vehicle_noise
from arva_hil.model.field import LocalFrame
from arva_hil.model.receiver import Look, Pose, Reading
from arva_hil.model.receiver.display import PulsedOptions
from tests.every import every
from tests.made_records import HOME, pose_at

TABLE = "h_na_m,d_m\n10,50\n100, 20\n100000,1.5\n"
PULSED = "model: pulsed, start_s: 0, steps: cm, noise: {kind: off}"


def scenario(folder: Path, receiver: str, table: str = TABLE, keying: str = "") -> Scenario:
    """Return a scenario beside a folder `p` with a profile of this receiver, and a table beside the profile."""
    (folder / "p").mkdir()
    (folder / "p/law.csv").write_text(table)
    (folder / "p/r.yaml").write_text(f"spec: 2\nreceiver: {{{receiver}}}\n")
    transmitter = f"{{id: 1, ned: [20, 0, 0]{keying}}}"
    (folder / "s.yaml").write_text(f"spec: 2\ntransmitters: [{transmitter}]\nreceiver: {{profile: p/r.yaml}}\n")
    return load(folder / "s.yaml")


def reading(of: Scenario, pose: Pose | None = None) -> Reading:
    """Return what the receiver shows after four seconds at a pose."""
    model, there = receiver(of), transmitters(of, LocalFrame(*HOME))
    t = 0.0
    while t < 4.0:
        model.look(Look(t, pose or pose_at(0.0), there))
        t = model.next_look(t, 4.0)
    return model.show(4.0)


def test_a_table_is_the_display_and_is_found_beside_its_profile(tmp_path: Path) -> None:
    own = scenario(tmp_path, f"{PULSED}, display: {{table: law.csv}}")
    assert own.receiver.display.table.d(10.0) == 50
    assert own.receiver.display.table.d(1.0) == 50
    assert own.receiver.display.table.d(1e9) == 1.5
    assert own.receiver.display.table.d(31.6228) == pytest.approx(50 * 0.4**0.5, rel=1e-4)
    usual = load_without(tmp_path)
    assert reading(usual).channels[0].d_cm == pytest.approx(2000, rel=0.2)
    field = 1.542 / (2 * (reading(usual).channels[0].d_cm / 100) ** 3) * 1e6
    assert reading(own).channels[0].d_cm == pytest.approx(100 * own.receiver.display.table.d(field), rel=0.01)
    assert to_dict(own)["receiver"]["display"] == {"table": str(tmp_path / "p/law.csv")}


def load_without(folder: Path) -> Scenario:
    (folder / "p/r.yaml").write_text(f"spec: 2\nreceiver: {{{PULSED}}}\n")
    return load(folder / "s.yaml")


@every(
    "text, at, found",
    [
        ("h_na_m,d_m\n10,50\n100,60\n", "3:5", "60 after 50, expected d that falls with the field"),
        ("h_na_m,d_m\n10,50\n9,20\n", "3:1", "9 after 10, expected fields that rise"),
        ("h_na_m,d_m\n10,50\n10,20\n", "3:1", "10 after 10"),
        ("h_na_m,d_m\n10,metres\n", "2:4", "'metres', expected a number above 0"),
        ("h_na_m,d_m\n-1,5\n", "2:1", "'-1'"),
        ("h_na_m,d_m\n1,2,3\n", "2:1", "3 values, expected two"),
        ("h,d\n1,2\n", "1:1", "'h,d', expected the header h_na_m,d_m"),
        ("h_na_m,d_m\n1,2\n", "3:1", "1 rows, expected two rows or more"),
    ],
)
def test_a_wrong_table_is_refused_at_its_line_and_column(text: str, at: str, found: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_law(text, "law.csv")
    assert str(caught.value).startswith(f"law.csv:{at}: {found}")


def test_a_wrong_table_is_a_mistake_of_the_profile(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"law\.csv:3:5: 60 after 50, expected d that falls"):
        scenario(tmp_path, f"{PULSED}, display: {{table: law.csv}}", "h_na_m,d_m\n10,50\n100,60\n")


def test_a_carrier_off_its_place_is_heard_less(tmp_path: Path) -> None:
    keyed = ", keying: {carrier_hz: 100}"
    own = scenario(tmp_path, f"{PULSED}, carrier_db: [[-100, -18], [0, 0], [100, -18]]", keying=keyed)
    assert reading(own).channels[0].d_cm == pytest.approx(
        reading(load_without(tmp_path)).channels[0].d_cm * 2, rel=0.01
    )
    assert PulsedOptions(carrier_db=((0, 0), (50, -6))).carrier_gain(25) == pytest.approx(0.708, abs=0.001)
    with pytest.raises(ValueError, match="expected Hz that rise, dB up to 0"):
        PulsedOptions(carrier_db=((0, 0), (0, -6)))


def test_measured_noise_over_the_load_stands_instead_of_motors(tmp_path: Path) -> None:
    own = scenario(tmp_path, f"{PULSED}, vehicle_noise: {{levels: [[0, 0.5], [0.5, 4], [1, 10]]}}")
    noise = vehicle_noise(own)
    assert noise is not None
    assert [noise.sigma_na_m((0, 0, 0.5), load) for load in (0, 0.25, 1)] == [0.5, 2.25, 10]


@every(
    "noise, message",
    [
        ("{}", "neither, expected motors, or levels"),
        ("{motors: [[0, 0, 0]], levels: [[0, 1], [1, 2]]}", "both, expected motors, or levels"),
        ("{levels: [[0, 1], [0, 2]]}", "0, expected a load above the one before"),
    ],
)
def test_noise_that_contradicts_itself_is_refused(noise: str, message: str, tmp_path_factory) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ScenarioError) as caught:
        scenario(tmp_path_factory.mktemp("noise"), f"{PULSED}, vehicle_noise: {noise}")
    assert message in str(caught.value)
