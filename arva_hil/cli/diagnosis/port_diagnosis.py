"""Turns measurements of the port where frames go into findings, as `diagnosis` does."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from arva_hil.cli.diagnosis.values import Finding, PortTraffic
from arva_hil.links.serial_ports import SerialPort

_OURS: Final = re.compile(
    r"(?:(?P<pid>\d+) \()?[^,()]*?(?:-m arva_hil|\barva-hil) (?P<command>run|demo|search|replay|vehicle|campaign|-)"
)


def held(check: str, link: str, what: str) -> Finding | None:
    """Return the finding if `what`, an error or a command line, names a running arva-hil command; else None."""
    if (found := _OURS.search(what)) is None:
        return None
    command = "run" if found["command"] == "-" else found["command"]
    process = f" (process {found['pid']})" if found["pid"] else ""
    end = f"Ctrl-C, or kill -INT {found['pid']}" if found["pid"] else "Ctrl-C"
    return Finding(
        check,
        "fail",
        f"{link}: a running arva-hil {command}{process} has it open",
        f"that command reports its own status; to examine this port, end it first ({end})",
    )


def no_port(candidates: Sequence[SerialPort]) -> Finding:
    """Report that no port was named: only the autopilot's link is examined. `candidates`: those that are free."""
    names = ", ".join(port.device for port in candidates[:6])
    there = f"free: {names}" if candidates else "no serial port is free for it"
    cures = [*[f"--port {port.device}" for port in candidates if port.usb][:1], "--port pty", "or --format tunnel"]
    return Finding("port", "note", f"none was named; {there}", ", ".join(cures))


def frames(traffic: PortTraffic, form: str) -> Finding:
    """Judge whether the port accepts frames."""
    if traffic.lost:
        return Finding("frames", "fail", traffic.lost, "plug it in again, or start the program at the other end")
    found = f"{traffic.taken} of {traffic.taken + traffic.dropped} {form} frames were accepted, all with no signal"
    if not traffic.taken:
        cure = {
            "mavlink": "there is no vehicle to send frames to, see above",
            "tcpin": "start the consumer: no client is connected; `run` waits for it",
            "udpin": "the consumer must send a datagram first; or give its address: --port udpout:HOST:PORT",
            "serial": "the other end does not read, or does not set CTS: is the consumer running?",
        }.get(traffic.kind, "start the consumer: no program reads; `run` waits for it")
        return Finding("frames", "fail", found, cure)
    if traffic.dropped:
        return Finding("frames", "note", found, "the consumer started late, or is too slow")
    return Finding("frames", "ok", found)


def reader(traffic: PortTraffic) -> Finding | None:
    """Judge whether a program reads; None if no frame was accepted, which `frames` reports."""
    if traffic.refused:
        return Finding("reader", "fail", "none: no program listens there", "start the consumer, or correct --port")
    if not traffic.taken or traffic.lost:
        return None
    if traffic.answered:
        return Finding("reader", "ok", f"{traffic.answered} bytes came back")
    who = ", ".join(traffic.seen)
    if traffic.kind == "pty":
        if who and traffic.unread:
            return Finding("reader", "note", f"{who} has it open and left {traffic.unread} bytes unread", "let it read")
        if who or not traffic.unread:
            return Finding("reader", "ok", f"{who or 'a program'} reads it")
        return Finding(
            "reader", "note", "no program has it open", f"arva-hil listen {traffic.name}, or start the consumer"
        )
    if traffic.kind in ("tcp", "tcpin"):
        return Finding("reader", "ok", "connected")
    if traffic.kind == "udpin":
        return Finding("reader", "ok", "a datagram came from there")
    if who:
        return Finding("reader", "ok", f"{who} has the other end")
    cure = {
        "mavlink": "a Lua script or a companion computer must read them; PX4 logs them, see firmware_proto/px4",
        "udpout": "UDP has no acknowledgement; run at the other end: arva-hil listen udpin:0.0.0.0:PORT",
    }.get(
        traffic.kind,
        "a serial line has no acknowledgement; ArduPilot: SERIALn_PROTOCOL 28 and SCR_ENABLE 1 for the Lua driver, "
        "SERIALn_BAUD 115; PX4: arva_receiver status; elsewhere arva-hil listen",
    )
    return Finding("reader", "note", "unknown", cure)
