"""The links of `run` and `doctor`: their choice and checks, the key for signing, and the command for them."""

from __future__ import annotations

import argparse
import os
import shlex
import stat
from collections.abc import Mapping
from contextlib import ExitStack, closing
from typing import Any, Final

from arva_hil.autopilot.following.session import Session
from arva_hil.cli.options import DEFAULT_AUTOPILOT
from arva_hil.cli.outcome import UsageError
from arva_hil.cli.terminal import tell
from arva_hil.config import Scenario
from arva_hil.links import Address, parse
from arva_hil.links.serial_ports import find_autopilot, list_ports
from arva_hil.links.url import excludes, place
from arva_hil.mavlink.signing import Signing, key_of
from arva_hil.registry import over_mavlink
from arva_hil.runtime.fleet_links import FleetSides, check_links, fleet_sides, ports_of
from arva_hil.runtime.signing_state import PersistentSigning, state_file


def choose_autopilot(*ports: str | None) -> str:
    """Return the one autopilot on USB, else the port where ground stations listen. Raises UsageError for several."""
    found = find_autopilot(list_ports(), exclude=[parse(port).path for port in ports if port])
    if len(found) > 1:
        names = ", ".join(p.device for p in found)
        raise UsageError(f"several autopilots are plugged in ({names}): choose one with --autopilot")
    return found[0].device if found else DEFAULT_AUTOPILOT


def check_sides(autopilot: str | None, port: str | None, form: str) -> None:
    """Check that frames of this format can go there. Raises UsageError."""
    inside = over_mavlink(form)
    if autopilot == "-":
        raise UsageError("--autopilot -: this is stdout, which cannot be read: name the autopilot's link")
    if inside and autopilot and parse(autopilot).kind == "tlog":
        raise UsageError(f"--autopilot {autopilot}: this is a log: frames with --format {form} cannot be sent there")
    if port is None:
        return
    if inside:
        raise UsageError(
            f"--format {form} goes over the autopilot's own link: leave out --port, or choose "
            "--format binary, nmea or text"
        )
    if parse(port).kind == "tlog":
        raise UsageError(f"--port {port}: this is a log: frames cannot be sent there; --record writes files")
    if not autopilot:
        return
    listeners = place(autopilot), place(port)
    if excludes(*listeners) or excludes(*reversed(listeners)):
        raise UsageError(f"--autopilot {autopilot} and --port {port} cannot both listen there: choose another port")
    if parse(port) != Address("pty") and listeners[0] == listeners[1]:
        raise UsageError(
            f"the autopilot and --port are both {port}: each side needs its own, or send the frames inside MAVLink "
            "with --format tunnel"
        )


def check_ground_station(url: str, autopilot: str, receiver: str) -> None:
    """Check that a ground station has a link of its own. Raises UsageError."""
    address = parse(url)
    if address.kind in ("tlog", "stdout"):
        raise UsageError(f"--gcs {url}: no ground station is there: name its link, e.g. udpout:127.0.0.1:14555")
    for name, other in (("autopilot", autopilot), ("receiver", receiver)):
        same_port = address.port != 0 and (address.host, address.port) == parse(other)[1:3]
        if same_port or (address != Address("pty") and place(url) == place(other)):
            raise UsageError(
                f"--gcs {url}: --{name} is there: the ground station needs a link of its own, because an autopilot may "
                "evade a vehicle that it receives from here"
            )


_OWN: Final = {"port": "each receiver has its own port", "target_system": "each vehicle has its own system"}


def refuse_own(options: argparse.Namespace, chosen: Scenario) -> None:
    """Raise UsageError for options of which each vehicle or receiver of the scenario has its own."""
    for option, why in _OWN.items():
        if getattr(options, option) is not None:
            raise UsageError(f"--{option.replace('_', '-')}: {chosen.source} has vehicles, and {why}: leave it out")


def chosen_sides(options: argparse.Namespace, chosen: Scenario) -> FleetSides:
    """Return the links of a run. Raises UsageError if options or addresses do not fit together."""
    if not chosen.vehicles:
        return _one_vehicle(options, chosen.output_format)
    refuse_own(options, chosen)
    named = all(vehicle.autopilot for vehicle in chosen.vehicles)
    if options.autopilot and named:
        raise UsageError(f"--autopilot: every vehicle of {chosen.source} names its own: leave it out")
    usual, ports = options.autopilot, ports_of(chosen)
    try:
        if not usual and not named:
            check_links(chosen.source, ports, {})  # so that each can be parsed
            usual = choose_autopilot(*ports.values())
        return fleet_sides(chosen, usual, json=options.json)
    except ValueError as error:
        raise UsageError(error) from None


def _one_vehicle(options: argparse.Namespace, form: str) -> FleetSides:
    inside = over_mavlink(form)
    if not inside and not options.port:
        raise UsageError(
            "--port is missing: name the port for the frames, e.g. --port /dev/ttyUSB0, --port pty, "
            "or --format tunnel to send them inside MAVLink"
        )
    if options.json and options.port == "-":
        raise UsageError("--json and --port - both go to stdout: choose one")
    check_sides(options.autopilot, options.port, form)
    return FleetSides(
        {"autopilot": options.autopilot or choose_autopilot(options.port)},
        {},
        {} if inside else {"port": options.port},
    )


def session(options: argparse.Namespace, **more: Any) -> Session:
    """Return a session with the vehicle that the options choose. `more`: see `Session`."""
    return Session(
        target_system=options.target_system,
        target_component=options.target_component,
        rate_hz=options.stream_rate,
        **more,
    )


_LARGEST: Final = 4096  # bytes


def signing(path: str | None, epoch_us: int, stack: ExitStack, link: int = 0) -> Signing | None:
    """Return signing with the key in a file. The clock reads 0 at `epoch_us` (µs since 1970). Raises UsageError.

    Its time stamps continue those of the last program with this key. They are saved when `stack` is closed.
    """
    if not path:
        return None
    key = _key(path)
    return stack.enter_context(closing(PersistentSigning(key, epoch_us, link, state_file(key, os.environ), tell)))


def _key(path: str) -> bytes:
    from arva_hil.config.reading import open_at_once  # slow to import

    wanted = "expected 64 hexadecimal digits (the key) or a passphrase, on one line"
    try:
        with open(path, "rb", opener=open_at_once) as file:
            mode = os.fstat(file.fileno()).st_mode
            if not stat.S_ISREG(mode):
                raise UsageError(f"--signing-key {path}: is not a file, {wanted}")
            if os.name == "posix" and mode & 0o077 and not _is_credential(path):
                raise UsageError(
                    f"--signing-key {path}: other users may read or write it ({mode & 0o777:o}): chmod 600 {path}"
                )
            data = file.read(_LARGEST + 1)
    except OSError as error:
        raise UsageError(f"--signing-key {path}: {error.strerror}, {wanted}") from None
    if len(data) > _LARGEST:
        raise UsageError(f"--signing-key {path}: more than {_LARGEST} bytes, {wanted}")
    try:
        return key_of(data.decode())
    except UnicodeDecodeError as error:
        raise UsageError(f"--signing-key {path}: byte {error.start + 1} is not text, {wanted}") from None
    except ValueError as error:
        raise UsageError(f"--signing-key {path}: {error}, {wanted}") from None


def _is_credential(path: str) -> bool:
    """Return True if systemd keeps the file for this service: mode 440, with an access list for the readers."""
    folder = os.environ.get("CREDENTIALS_DIRECTORY")
    return bool(folder) and os.path.dirname(os.path.realpath(path)) == os.path.realpath(str(folder))


UNKNOWN_PORT: Final = "pty:/tmp/arva0"


def next_command(
    options: argparse.Namespace, autopilot: str, usb_ports: list[str], right: Mapping[str, str | None]
) -> str:
    """Return the `run` command with the same options, where `right` replaces the wrong ones.

    `autopilot`: the address of the autopilot. `usb_ports`: where frames may go if no port was named. `right`: right
    values by the option's name; a name in capitals if the value is not known, None to leave the option out.
    """
    words: dict[str, str | None] = {"autopilot": autopilot}
    if over_mavlink(options.format):
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
