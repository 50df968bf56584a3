"""The two links of `run` and `doctor`: the autopilot's link, and the port where frames go."""

from __future__ import annotations

from arva_hil.cli.options import DEFAULT_AUTOPILOT
from arva_hil.cli.outcome import UsageError
from arva_hil.links import Address, parse
from arva_hil.links.serial_ports import find_autopilot, list_ports
from arva_hil.links.url import place
from arva_hil.registry import MAVLINK_FORMATS


def choose_autopilot(*ports: str | None) -> str:
    """The one autopilot on USB, else the port where ground stations listen. Raises UsageError for several."""
    found = find_autopilot(list_ports(), exclude=[port.partition(",")[0] for port in ports if port])
    if len(found) > 1:
        names = ", ".join(p.device for p in found)
        raise UsageError(f"several autopilots are plugged in ({names}): choose one with --autopilot")
    return found[0].device if found else DEFAULT_AUTOPILOT


def check_sides(autopilot: str | None, port: str | None, form: str) -> None:
    """Whether frames of this format can go there. Raises UsageError."""
    over_mavlink = form in MAVLINK_FORMATS
    if autopilot == "-":
        raise UsageError("--autopilot -: this is stdout, which cannot be read: name the autopilot's link")
    if over_mavlink and autopilot and parse(autopilot).kind == "tlog":
        raise UsageError(f"--autopilot {autopilot}: this is a log: frames with --format {form} cannot be sent there")
    if port is None:
        return
    if over_mavlink:
        raise UsageError(
            f"--format {form} goes over the autopilot's own link: leave out --port, or choose "
            "--format binary, nmea or text"
        )
    if parse(port).kind == "tlog":
        raise UsageError(f"--port {port}: this is a log: frames cannot be sent there; --record writes files")
    if autopilot and parse(port) != Address("pty") and place(autopilot) == place(port):
        raise UsageError(
            f"the autopilot and --port are both {port}: each side needs its own, or send the frames inside MAVLink "
            "with --format tunnel"
        )


def check_ground_station(url: str, autopilot: str, receiver: str) -> None:
    """Whether a ground station has a link of its own. Raises UsageError."""
    address = parse(url)
    if address.kind in ("tlog", "stdout"):
        raise UsageError(f"--gcs {url}: no ground station is there: name its link, e.g. udpout:127.0.0.1:14555")
    for name, other in (("autopilot", autopilot), ("receiver", receiver)):
        same_port = address.port != 0 and (address.host, address.port) == parse(other)[1:3]
        if same_port or (address != Address("pty") and place(url) == place(other)):
            raise UsageError(
                f"--gcs {url}: --{name} is there: the ground station needs a link of its own, because an autopilot may "
                "evade what is shown on the map"
            )
