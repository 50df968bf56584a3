"""The command to type after `doctor`: the options that were given, with the wrong ones corrected."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping
from typing import Final

from arva_hil.registry import MAVLINK_FORMATS

UNKNOWN_PORT: Final = "pty:/tmp/arva0"


def next_command(
    options: argparse.Namespace, autopilot: str, usb_ports: list[str], right: Mapping[str, str | None]
) -> str:
    """The `run` command with the same options, where `right` replaces the wrong ones.

    `autopilot`: the address that was heard. `usb_ports`: where frames may go if no port was named. `right`: right
    values by the option's name; a word in capitals if the value is not known, None to leave the option out.
    """
    words: dict[str, str | None] = {"autopilot": autopilot}
    if options.format in MAVLINK_FORMATS:
        words["format"] = options.format
    else:
        words["port"] = options.port or (usb_ports[0] if len(usb_ports) == 1 else UNKNOWN_PORT)
        words["format"] = options.format if options.format != "binary" else None
    for name in ("target_system", "target_component", "signing_key"):
        value = getattr(options, name)
        words[name] = None if value is None else str(value)
    words["stream_rate"] = f"{options.stream_rate:g}" if options.stream_rate != 50.0 else None
    words |= {name: value for name, value in right.items() if name in words}
    each = ((f"--{name.replace('_', '-')}", value) for name, value in words.items() if value is not None)
    return shlex.join(["arva-hil", "run", *(word for pair in each for word in pair)])
