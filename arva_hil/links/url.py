"""Connection strings: `parse` makes an `Address` of one, or raises an error with the cure."""

from __future__ import annotations

import os
import re
from typing import Final, NamedTuple

from arva_hil.errors import ArvaError
from arva_hil.registry import LINKS

_LOOPBACK: Final = "127.0.0.1"
_LOG: Final = ".tlog"
_NETWORK: Final = {"udpin": "udpin", "udpout": "udpout", "tcp": "tcp", "tcpout": "tcp", "tcpin": "tcpin"}
_KINDS: Final = {*_NETWORK.values(), "serial", "pyserial", "pty", "tlog", "stdout"}  # with spellings of their own
_USUAL_PORT: Final[dict[str, int]] = {"udpin": 14550, "udpout": 14550, "tcp": 5760, "tcpin": 5760}
# Patterns are compiled when they are first used: it would take a third of this package's import time.
_PYSERIAL: Final = r"(?i:rfc2217|socket|loop|spy|hwgrep|alt)://.*"
_DEVICE: Final = r"\.{0,2}/.*[^/]|(?i:(?:\\\\\.\\)?COM[0-9]+)"
_SCHEME: Final = r"([A-Za-z][A-Za-z0-9+.-]+):(.*)"  # two letters at least: C:\ is a drive
_HOST_PORT: Final = r"(?:(\[[0-9A-Fa-f:.]+(?:%\w+)?\]|[^\s:/\[\]]*):)?([^\s:/\[\]]*)"
_BARE_HOST_PORT: Final = r"(?:\[.*\]|[^\s:/\\]*):[0-9]+"
_EXAMPLES: Final = ("/dev/ttyACM0,57600", "COM5", "pty", "udpin:127.0.0.1:14550", "tcp:127.0.0.1:5760", "log.tlog")


class AddressError(ArvaError, ValueError):
    """A wrong connection string. `found`: what is wrong with it; `cure`: what to write instead, "" if not known."""

    def __init__(self, found: str, *examples: str) -> None:
        *first, last = examples or ("",)
        self.found, self.cure = found, f"{', '.join(first)}{' or ' if first else ''}{last}"
        super().__init__(f"{found}: write {self.cure}" if self.cure else found)


class Address(NamedTuple):
    """A parsed connection string. `parse(str(address))` gives the same address.

    - `kind`: a name in the registry of links.
    - `path`: a device, a file, a symlink to make (pty), or a URL of pyserial; for the kinds of other packages, all text
      after the scheme.
    - `baud`: in bit/s; None if the string has none.
    """

    kind: str
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int | None = None

    def __str__(self) -> str:
        if self.kind in _USUAL_PORT:
            return f"{self.kind}:{show(self.host, self.port)}"
        forms = {
            "serial": self.path + (f",{self.baud}" if self.baud else ""),
            "pyserial": self.path,
            "pty": f"pty:{self.path}" if self.path else "pty",
            "tlog": self.path if self.path.lower().endswith(_LOG) else f"file:{self.path}",
            "stdout": "-",
        }
        return forms.get(self.kind, f"{self.kind}:{self.path}")


def show(host: str, port: int) -> str:
    """Return a host and a port as in a connection string."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def parse(text: str) -> Address:
    """Parse a connection string. Raises AddressError, with examples, if it is wrong or ambiguous."""
    text = text.strip()
    if not text:
        raise _refused(text, "is empty", *_EXAMPLES)
    if text == "-":
        return Address("stdout")
    if text.lower() == "pty":
        return Address("pty")
    if re.fullmatch(_PYSERIAL, text):
        return Address("pyserial", path=text)
    scheme, rest = _split_scheme(text)
    if scheme in _NETWORK:
        return _network(text, scheme, rest)
    if scheme == "serial":
        return _serial(text, rest, colon=True)
    if scheme in ("pty", "file"):
        if not rest:
            raise _refused(text, "has no path", "pty:/tmp/arva0" if scheme == "pty" else "file:log.tlog")
        return Address("pty" if scheme == "pty" else "tlog", path=rest)
    if scheme == "udp":
        target = _target(rest)
        raise _refused(text, "does not say which side listens", f"udpin:{target}", f"udpout:{target}")
    if re.fullmatch(_BARE_HOST_PORT, text) and not re.fullmatch(_DEVICE, text.partition(":")[0]):
        target = _target(text)
        examples = f"udpin:{target}", f"udpout:{target}", f"tcp:{target}"
        raise _refused(text, "could be UDP or TCP", *examples)
    if scheme and scheme not in _KINDS and scheme in LINKS:
        return Address(scheme, path=rest)
    if scheme:
        raise _refused(text, f"starts with {scheme!r}, which is not a kind of link", *_EXAMPLES)
    if text.lower().endswith(_LOG):
        return Address("tlog", path=text)
    if re.match(_DEVICE, text):
        return _serial(text, text, colon=False)
    raise _refused(text, "is no connection", *_EXAMPLES)


def _split_scheme(text: str) -> tuple[str, str]:
    """Return ('udpin', 'host:port') for udpin:host:port and udpin://host:port; ('', text) without a scheme."""
    match = re.fullmatch(_SCHEME, text)
    if not match or re.fullmatch(_DEVICE, match[1]):
        return "", text
    return match[1].lower(), match[2].removeprefix("//")


def _network(text: str, scheme: str, rest: str) -> Address:
    kind = _NETWORK[scheme]
    usual = _USUAL_PORT[kind]
    rest = rest.removesuffix("/")
    match = re.fullmatch(_HOST_PORT, rest)
    if not match:
        raise _refused(text, "is not a host and a port", f"{scheme}:{_LOOPBACK}:{usual}", f"{scheme}:[::1]:{usual}")
    host, port = match[1], match[2]
    if host is None and not port.isdecimal():
        host, port = port, ""
    if not port:
        raise _refused(text, "has no port", f"{scheme}:{host or _LOOPBACK}:{usual}")
    if not re.fullmatch("[0-9]{1,5}", port) or not 1 <= int(port) <= 65535:
        what = f"has the port {port!r}, which is not a number 1…65535"
        raise _refused(text, what, f"{scheme}:{host or _LOOPBACK}:{usual}")
    if not host and kind not in ("udpin", "tcpin"):
        raise _refused(text, "has no host", f"{scheme}:{_LOOPBACK}:{port}")
    return Address(kind, host=(host or _LOOPBACK).strip("[]"), port=int(port))


def _serial(text: str, rest: str, *, colon: bool) -> Address:
    """Return a device and its baud rate, after a comma; after a scheme a colon is allowed too."""
    path, comma, baud = rest.rpartition(",")
    if not comma:
        path, baud = rest, ""
        if behind := re.fullmatch("(.*):([0-9]{2,})", rest):  # names in /dev/serial/by-path have colons too
            path, baud = behind.groups()
            if not colon:
                raise _refused(text, "has a colon before the baud rate", f"{path},{baud}", f"serial:{rest}")
    if not re.fullmatch(_DEVICE, path):
        raise _refused(text, f"has the device {path!r}", "/dev/ttyACM0,57600", "serial:/dev/ttyACM0", "COM5")
    if not baud and not comma:
        return Address("serial", path=path)
    if not re.fullmatch("[0-9]{2,8}", baud) or int(baud) < 50:
        raise _refused(text, f"has the baud rate {baud!r}, which is not a number of bit/s", f"{path},57600")
    return Address("serial", path=path, baud=int(baud))


def place(url: str) -> Address:
    """Return an address that is equal for all spellings of the same link. Raises AddressError."""
    where = parse(url)
    host = _LOOPBACK if where.host.lower() == "localhost" else where.host
    return where._replace(host=host, path=os.path.realpath(where.path) if where.path else "", baud=None)


def excludes(one: Address, other: Address) -> bool:
    """Return True if `one` listens at all addresses of the machine, so that `other` cannot listen at its own."""
    if one.kind != other.kind or one.kind not in ("udpin", "tcpin") or one.port != other.port or one.host == other.host:
        return False
    if one.host == "::":  # also for IPv4 over UDP
        return one.kind == "udpin" or ":" in other.host
    return one.host == "0.0.0.0" and ":" not in other.host


def _target(rest: str) -> str:
    """Return the typed host:port, completed for an example."""
    host, _, port = rest.rpartition(":")
    if not port.isdecimal():
        host, port = host or port, "14550"
    return f"{host or _LOOPBACK}:{port}"


def _refused(text: str, found: str, *examples: str) -> AddressError:
    return AddressError(f"{text!r} {found}", *examples)
