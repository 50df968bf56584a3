"""`arva-hil fit`: estimates a receiver's profile from records, with uncertainties."""

from __future__ import annotations

import argparse
import os
from contextlib import nullcontext
from pathlib import Path

from arva_hil.cli.outcome import FAILED, OK, Failure, UsageError
from arva_hil.cli.recorded import loaded, needing, output
from arva_hil.cli.terminal import show_one, tell
from arva_hil.records.fitting import FitError, ReceiverFit, flight_of
from arva_hil.records.fitting.scatter import Gps


def main(options: argparse.Namespace) -> int:
    if not options.out:
        raise UsageError("--out is missing: name the profile to write, e.g. --out my_receiver.yaml")
    if options.scenario_out and os.path.realpath(options.scenario_out) == os.path.realpath(options.out):
        raise UsageError(f"--out and --scenario-out are both {options.out}: name two files")
    if options.out == "-" and options.scenario_out:
        raise UsageError("--scenario-out: the scenario names the file of the profile: name one with --out")
    on_stdout = "-" in (options.out, options.scenario_out)
    if on_stdout and options.json:
        raise UsageError("--json and the file both go to stdout: choose one")
    with needing("fit", "fit"):
        import scipy  # noqa: F401 (before seconds of reading)

        from arva_hil.records.fitting import profile
        from arva_hil.records.fitting.fit import fit
    records = [loaded(name) for name in options.records]
    site = options.scenario_out
    with output(site, *records) if site else nullcontext() as site_out, output(options.out, *records) as out:
        try:
            flights = [flight_of(record) for record in records]
            found = fit(flights, options.model, Gps(options.gps_sigma, options.gps_tau))
        except FitError as error:
            raise Failure(FAILED, error) from None
        out.write(profile.profile(found, [record.run.started if record.run else "" for record in records]).encode())
        if site_out:
            site_out.write(profile.scenario(found, os.path.relpath(options.out, Path(site).parent)).encode())
    if on_stdout:
        tell(*lines(found))
    else:
        show_one(found.as_json(), *lines(found), as_json=options.json)
    tell(*(f"warning: {doubt}" for doubt in found.doubts))
    return FAILED if found.doubts else OK


def lines(found: ReceiverFit) -> list[str]:
    """Return the estimates for a person."""
    turn = "" if found.delta_scatter_deg is None else f", δ {found.delta_scatter_deg:.1f}°"
    said = [
        f"{found.readings} readings, {found.outliers} outliers; residuals: d {100 * found.d_scatter:.1f} %{turn}",
        f"{'':22}{'value':>10} {'95 % interval':>24}",
    ]
    for one in found.estimates.values():
        unit = f" {one.unit}" if one.unit else ""
        interval = f"{one.low:.4g} … {one.high:.4g}{unit}"
        like = f" apart from {one.like}" if one.like else ""
        told = "" if one.identified else f"  unknown{like}"
        said.append(f"{one.name:22}{one.value:>10.4g} {interval:>24}{told}")
    said.append("kappa_eq is that of a transmitter of strength 1: the flight gives only their ratio")
    return [*said, *found.advice]
