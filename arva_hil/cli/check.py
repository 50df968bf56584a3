"""`arva-hil check`: reads files, and prints their mistakes or a summary."""

from __future__ import annotations

import argparse
import json
import os
from typing import Final

from arva_hil.cli.outcome import OK, USAGE, UsageError
from arva_hil.cli.terminal import show, tell
from arva_hil.config import Scenario, ScenarioError, newer_keys, parse
from arva_hil.config.campaign import is_plan, parse_plan
from arva_hil.config.json_schema import schema_text
from arva_hil.config.profiles import located, parse_profile, profile_kind
from arva_hil.config.reading import read_text

_NO_PORT: Final = "the autopilot's link"
_COMMAND_LINES: Final = "file:the link of the command line"  # like no other


def main(options: argparse.Namespace) -> int:
    if options.schema:
        if options.files:
            raise UsageError(f"--schema: it checks no file: leave out {options.files[0]}")
        show(*schema_text(options.schema).splitlines())
        return OK
    if not options.files:
        raise UsageError("the following arguments are required: FILE", "see arva-hil check --help")
    code = OK
    for name in options.files:
        try:
            path = located(name)
            _check(path, read_text(path, "a scenario file"))
        except ScenarioError as error:
            tell(*error.problems)
            code = USAGE
        except UsageError as error:
            tell(error)
            code = USAGE
    return code


def _check(name: str, text: str) -> None:
    """Print a summary of a file. Raises ScenarioError, and UsageError for links that do not fit together."""
    if of := profile_kind(text):
        parse_profile(text, of, name)
        show(f"{name}: ok: the profile of a {of}")
        own = f"profile: {json.dumps(os.path.basename(name))}"
        keys, hears = (f", {own}", "model: pulsed") if of == "transmitter" else ("", own)
        text = f"spec: 2\ntransmitters: [{{id: 0, ned: [0, 0, 0]{keys}}}]\nreceiver: {{{hears}}}"
        tell(*(f"{name}: warning: {remark.partition(': ')[2]}" for remark in _outside_norm(parse(text, name))))
        return
    if is_plan(text):
        from arva_hil.campaign.plan import size

        plan = parse_plan(text, name)
        show(f"{name}: ok: {size(plan)} trials of {', '.join(plan.strategies)}; {', '.join(plan.scenarios)}")
        return
    chosen = parse(text, name)
    if chosen.vehicles:
        from arva_hil.runtime.fleet_links import fleet_sides

        try:
            fleet_sides(chosen, _COMMAND_LINES)
        except ValueError as error:
            raise UsageError(error) from None
    ids = ", ".join(str(t.id) for t in chosen.transmitters)
    usual = f"{chosen.receiver.rate_hz:g} Hz, {chosen.output_format}"
    show(f"{name}: ok: transmitters {ids}; {f'vehicles {len(chosen.vehicles)}' if chosen.vehicles else usual}")
    show(
        *(
            f"  {vehicle.name}/{one.name}: {one.receiver.rate_hz:g} Hz, {one.output_format} to {one.port or _NO_PORT}"
            for vehicle in chosen.vehicles
            for one in vehicle.receivers
        )
    )
    show(*(f"  fault {fault}" for fault in chosen.faults))
    tell(*(f"{name}: warning: {remark}" for remark in _outside_norm(chosen)))


def _outside_norm(chosen: Scenario) -> list[str]:
    if not newer_keys(chosen):
        return []
    from arva_hil.emulator.build import outside_norm  # with numpy

    return outside_norm(chosen)
