"""`arva-hil ports`: prints the serial ports."""

from __future__ import annotations

import argparse

from arva_hil.cli.options import CommandParser
from arva_hil.cli.outcome import OK
from arva_hil.cli.terminal import show, show_json


def options(parser: CommandParser) -> None:
    """List the serial ports, and mark those that look like an autopilot."""
    parser.option("--json", "print a JSON object for each port")


def main(options: argparse.Namespace) -> int:
    from arva_hil.links.serial_ports import list_ports

    ports = list_ports()
    for port in ports:
        if options.json:
            show_json({**port._asdict(), "usb": port.usb})
        else:
            what = " | ".join(filter(None, [port.description, port.usb, port.by_id]))
            show(f"{port.device}  {'AUTOPILOT  ' if port.autopilot else ''}{what}")
    if not ports and not options.json:
        show("no serial ports; a USB adapter appears as /dev/ttyUSB0 or /dev/ttyACM0, COM3 on Windows")
    return OK
