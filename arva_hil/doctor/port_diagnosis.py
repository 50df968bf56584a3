"""What was measured of the port where frames go becomes findings, as in `diagnosis`."""

from __future__ import annotations

from collections.abc import Sequence

from arva_hil.doctor.values import Finding, PortTraffic


def no_port(candidates: Sequence[str], usb: Sequence[str]) -> Finding:
    """No port was named; only the autopilot's side is looked at. `usb`: those of the candidates that are on USB."""
    there = f"there is {', '.join(candidates[:6])}" if candidates else "no serial port is free for it"
    cures = [*(f"--port {device}" for device in usb[:1]), "--port pty", "or --format tunnel"]
    return Finding("port", "note", f"none was named; {there}", ", ".join(cures))


def frames(way: PortTraffic, form: str) -> Finding:
    """Whether the port takes them."""
    if way.lost:
        return Finding("frames", "fail", way.lost, "plug it in again, or start what is behind it")
    found = f"{way.taken} of {way.taken + way.dropped} {form} frames were taken, all saying no signal"
    if not way.taken:
        cure = {
            "mavlink": "there is no vehicle to send them to, see above",
            "tcpin": "start the consumer: nobody is connected; `run` waits for it",
            "udpin": "let the consumer send a datagram first, or name it: --port udpout:HOST:PORT",
            "serial": "the other end is full and not read, or holds CTS: is the consumer running?",
        }.get(way.kind, "start the consumer: nobody takes them; `run` waits for it")
        return Finding("frames", "fail", found, cure)
    if way.dropped:
        return Finding("frames", "note", found, "the consumer came late, or is slower than the frames")
    return Finding("frames", "ok", found)


def reader(way: PortTraffic) -> Finding | None:
    """Whether anybody reads; None when no frame was taken, which says it."""
    if way.refused:
        return Finding("reader", "fail", "none: nobody listens there", "start the consumer, or correct --port")
    if not way.taken or way.lost:
        return None
    if way.answered:
        return Finding("reader", "ok", f"{way.answered} bytes came back")
    who = ", ".join(way.seen)
    if way.kind == "pty":
        if who and way.unread:
            return Finding("reader", "note", f"{who} has it open and left {way.unread} bytes unread", "let it read")
        if who or not way.unread:
            return Finding("reader", "ok", f"{who or 'somebody'} reads it")
        return Finding("reader", "note", "nobody has it open", f"arva-hil listen {way.name}, or start the consumer")
    if way.kind in ("tcp", "tcpin"):
        return Finding("reader", "ok", "connected")
    if way.kind == "udpin":
        return Finding("reader", "ok", "a datagram came from there")
    if who:
        return Finding("reader", "ok", f"{who} has the other end")
    cure = {
        "mavlink": "a Lua script or a companion has to; PX4 keeps them in its log, see firmware_proto/px4",
        "udpout": "UDP does not tell; at the other end: arva-hil listen udpin:0.0.0.0:PORT",
    }.get(
        way.kind,
        "a serial line does not tell; ArduPilot: SERIALn_PROTOCOL 28 and SCR_ENABLE 1 for the Lua driver, SERIALn_BAUD "
        "115; PX4: arva_receiver status; elsewhere arva-hil listen",
    )
    return Finding("reader", "note", "unknown", cure)
