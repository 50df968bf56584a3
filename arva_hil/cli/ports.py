"""`arva-hil ports`: prints the serial ports."""

from __future__ import annotations

import argparse

from arva_hil.cli.terminal import show, show_json
from arva_hil.links.serial_ports import list_ports


def main(options: argparse.Namespace) -> None:
    ports = list_ports()
    for port in ports:
        if options.json:
            show_json({**port._asdict(), "usb": port.usb})
        else:
            what = " | ".join(filter(None, [port.description, port.usb, port.by_id]))
            show(f"{port.device}  {'AUTOPILOT  ' if port.autopilot else ''}{what}")
    if not ports and not options.json:
        show("no serial ports; a USB adapter appears as /dev/ttyUSB0 or /dev/ttyACM0, COM3 on Windows")
