"""The address of the page: HOST:PORT, and its optional parts. Imports nothing slow."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_PORT: Final = 8457


_PATTERN: Final = re.compile(
    r"(?P<only>[0-9]{1,5})|(?P<host>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(:(?P<port>[0-9]{1,5}))?", re.ASCII
)


class HostPort(NamedTuple):
    """`host`: a name or an IP address without brackets."""

    host: str = DEFAULT_HOST
    port: int = DEFAULT_PORT

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def url(self) -> str:
        """The URL of the page on this computer."""
        host = {"0.0.0.0": DEFAULT_HOST, "::": "::1"}.get(self.host, self.host)
        return f"http://{self._replace(host=host)}/"


def parse_address(text: str, usual: HostPort | None = None) -> HostPort:
    """Parse HOST:PORT, HOST or PORT; an IPv6 address in brackets. Raises ValueError.

    `usual`: the parts that the text leaves out.
    """
    usual, match = usual or HostPort(), _PATTERN.fullmatch(text)
    port = int(match["port"] or match["only"] or usual.port) if match else -1
    if match is None or port > 65535:
        raise ValueError(f"{text!r}: expected HOST:PORT, HOST or PORT, e.g. {usual}")
    return HostPort((match["host"] or usual.host).strip("[]"), port)
