"""The links of a run whose scenario names its vehicles, as the command line wants them."""

from __future__ import annotations

import argparse
from typing import Final

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.run_links import choose_autopilot
from arva_hil.config import Scenario
from arva_hil.fleet_links import FleetSides, fleet_sides, ports_of

_OWN: Final = {"port": "each receiver has its own port", "target_system": "each vehicle has its own system"}


def refuse_own(options: argparse.Namespace, chosen: Scenario) -> None:
    """Raises UsageError for options of which each vehicle or receiver of the scenario has its own."""
    for option, why in _OWN.items():
        if getattr(options, option) is not None:
            raise UsageError(f"--{option.replace('_', '-')}: {chosen.source} has vehicles, and {why}: leave it out")


def chosen_sides(options: argparse.Namespace, chosen: Scenario) -> FleetSides:
    """The links of a scenario with vehicles. Raises UsageError if options or addresses do not fit together."""
    refuse_own(options, chosen)
    named = all(vehicle.autopilot for vehicle in chosen.vehicles)
    if options.autopilot and named:
        raise UsageError(f"--autopilot: every vehicle of {chosen.source} names its own: leave it out")
    usual = options.autopilot
    if not usual and not named:
        usual = choose_autopilot(*ports_of(chosen).values())
    try:
        return fleet_sides(chosen, usual, json=options.json)
    except ValueError as error:
        raise UsageError(error) from None
