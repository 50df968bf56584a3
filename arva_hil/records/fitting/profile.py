"""A fit as files: the profile of the receiver, and a scenario with its transmitters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from arva_hil import __version__
from arva_hil.records.fitting.parameters import name_of
from arva_hil.records.fitting.result import ReceiverFit
from arva_hil.records.reading import NO_ID
from arva_hil.safe_text import one_line

_PULSE_AGE_S: Final = 0.5  # mean age of a reading of pulses, which the model has itself: half the usual period


def profile(fit: ReceiverFit, dates: Sequence[str]) -> str:
    """Return the text of a profile (YAML). `dates`: of the records, UTC."""
    get = {name: one.value for name, one in fit.estimates.items()}
    position = ", ".join(f"{get[f'mount {axis}']:.3f}" for axis in "xyz")
    lines = [
        *_head(fit, dates),
        "spec: 2",
        "receiver:",
        f"  model: {fit.model}",
        f"  kappa_eq: {get['kappa_eq']:.5g}  {_interval(fit, 'kappa_eq')}",
        f"  mount: {{position: [{position}], attitude: {{roll: 0, pitch: 0, yaw: {get['mount yaw']:.2f}}}}}",
        *(f"  # mount {axis} {_interval(fit, f'mount {axis}')[2:]}" for axis in ("x", "y", "z", "yaw")),
        f"  rate_hz: {min(max(1 / fit.flights[0].frame_s, 0.1), 50.0):.4g}",
        *(_paper(fit) if fit.model == "paper" else _pulsed(fit)),
    ]
    return "\n".join(lines) + "\n"


def scenario(fit: ReceiverFit, profile_name: str) -> str:
    """Return the text of a scenario with the transmitters, the latency as a fault, and the profile by its file name."""
    get = {name: one.value for name, one in fit.estimates.items()}
    late_s = get["latency"] - (0.0 if fit.model == "paper" else _PULSE_AGE_S)
    lines = [
        "# The transmitters and the latency of a fit; the receiver is in the profile.",
        "spec: 2",
        f"receiver: {{profile: {profile_name}}}",
        *([f"faults: [{{delay_s: {late_s:.3f}}}]"] if late_s >= 0.001 else []),
        "transmitters:",
    ]
    for id_ in fit.ids:
        name = name_of(id_)
        ned = ", ".join(f"{get[f'{name} {axis}']:.2f}" for axis in ("north", "east", "down"))
        attitude = f"{{roll: 0, pitch: {get[f'{name} pitch']:.1f}, yaw: {get[f'{name} yaw']:.1f}}}"
        strength = get.get(f"{name} strength", 1.0)
        shown = 0 if id_ == NO_ID else id_
        lines.append(f"  - {{id: {shown}, ned: [{ned}], attitude: {attitude}, strength: {strength:.4g}}}")
    return "\n".join(lines) + "\n"


def _head(fit: ReceiverFit, dates: Sequence[str]) -> list[str]:
    turn = "" if fit.delta_scatter_deg is None else f", δ {fit.delta_scatter_deg:.1f}°"
    names = [one_line(Path(flight.name).name) for flight in fit.flights]
    return [
        f"# Fitted by arva-hil {__version__} fit. Each interval contains the truth with 95 % probability.",
        *(f"# record {name}, {one_line(date) or 'of unknown date'}" for name, date in zip(names, dates, strict=True)),
        f"# residuals of {fit.readings} readings: d {100 * fit.d_scatter:.1f} %{turn}; outliers: {fit.outliers}",
        *(f"# doubt: {one_line(one)}" for one in fit.doubts),
        f"# latency {_interval(fit, 'latency')[2:]}",
    ]


def _interval(fit: ReceiverFit, name: str) -> str:
    one = fit.estimates[name]
    told = "" if one.identified else "; not determined by the flight"
    return f"# {one.low:.4g} … {one.high:.4g} {one.unit}".rstrip() + told


def _paper(fit: ReceiverFit) -> list[str]:
    ratio = fit.estimates["sensitivity y / x"].value
    x, y = (1.0, ratio) if ratio <= 1 else (1 / ratio, 1.0)
    floor = fit.estimates["floor_range_m"]
    return [
        f"  sensitivity: [{x:.3f}, {y:.3f}, 0.6]  {_interval(fit, 'sensitivity y / x')} (y / x); z is assumed",
        f"  noise: {{kind: uniform, floor_range_m: {floor.value:.1f}}}  {_interval(fit, 'floor_range_m')}",
    ]


def _pulsed(fit: ReceiverFit) -> list[str]:
    flights = fit.flights
    lines = [f"  noise_na_m: {fit.estimates['noise_na_m'].value:.3g}  {_interval(fit, 'noise_na_m')}"]
    far = [flight.heard_until_m for flight in flights if flight.heard_until_m is not None]
    if far:
        field = fit.estimates["kappa_eq"].value / (4 * math.pi * max(far) ** 3) * 2e6 * math.pi
        lines.append(f"  threshold_na_m: {field:.4g}  # the largest d, {max(far):.1f} m; it was lost beyond")
    if fit.model == "rssi":
        return lines
    ratio = fit.estimates["gain y / x"].value
    x, y = (1.0, ratio) if ratio <= 1 else (1 / ratio, 1.0)
    lines.append(f"  gains: [{x:.3f}, {y:.3f}, 1]  {_interval(fit, 'gain y / x')} (y / x); z is assumed")
    near = [flight.near_m for flight in flights if flight.near_m is not None]
    if near:
        lines.append(f"  third_within_m: {max(near):.1f}")
    lines.append(f"  steps: {'digits' if max(max(flight.d_step) for flight in flights) > 0.05 else 'cm'}")
    step = math.degrees(max(flight.delta_step for flight in flights))
    if step > 2:
        lines.append(f"  directions: {round(180 / step)}")
    return lines
