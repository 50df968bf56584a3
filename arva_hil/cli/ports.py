"""`arva-hil ports`: prints the serial ports."""

from __future__ import annotations

import argparse

from arva_hil.cli.terminal import show, show_one
from arva_hil.links.serial_ports import list_ports


def main(options: argparse.Namespace) -> None:
    ports = list_ports()
    for port in ports:
        what = " | ".join(filter(None, [port.description, port.usb, port.by_id]))
        line = f"{port.device}  {'AUTOPILOT  ' if port.autopilot else ''}{what}"
        show_one({**port._asdict(), "usb": port.usb}, line, as_json=options.json)
    if not ports and not options.json:
        show("no serial ports; a USB adapter appears as /dev/ttyUSB0 or /dev/ttyACM0, COM3 on Windows")
