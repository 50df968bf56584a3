"""One request of a browser: parsed from bytes of bounded size, and refused if another page has sent it."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Final, NamedTuple
from urllib.parse import parse_qs, urlsplit

from arva_hil.errors import ArvaError

MOST_HEAD: Final = 1 << 14  # bytes of a request; it has no body

_LONGEST_QUERY: Final = 200
_REQUEST: Final = re.compile(r"(?P<method>[!-~]{1,32}) (?P<target>[!-~]+) HTTP/1\.(?P<minor>[01])", re.ASCII)
_FIELD: Final = re.compile(r"([\w!#$%&'*+.^`|~-]+):[ \t]*(.*)", re.ASCII)


class Refused(ArvaError):
    """A request that is not answered. `status`: of HTTP; `str()`: the reason."""

    def __init__(self, status: HTTPStatus, why: str = "") -> None:
        super().__init__(why or status.phrase)
        self.status = status


class Request(NamedTuple):
    """A request for the content of a `path`. `headers`: by their names in lower case."""

    method: str
    path: str
    query: Mapping[str, str]
    headers: Mapping[str, Sequence[str]]
    is_last: bool  # the connection ends after the answer

    def refuse_others(self, host: str, here: str) -> None:
        """Raise Refused for a request of another page, or for a host name that is not ours.

        `host`: that the server was bound to. `here`: the address that was connected to.
        """
        hosts = self.headers.get("host", ())
        if len(hosts) != 1 or not _is_ours(hosts[0].lower(), host.lower(), here):
            why = "this host name is not served here: use the address that the program has printed"
            raise Refused(HTTPStatus.FORBIDDEN, why)
        if any(origin.lower() != f"http://{hosts[0].lower()}" for origin in self.headers.get("origin", ())):
            raise Refused(HTTPStatus.FORBIDDEN, "only the page of this address may ask")


def parse_request(data: bytearray, end: int) -> Request:
    """Parse the request in the first `end` bytes; -1: it is longer than `MOST_HEAD`. Raises Refused."""
    if end < 0:
        raise Refused(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
    first, *lines = data[:end].decode("latin-1").split("\r\n")
    fields = [_FIELD.fullmatch(line) for line in lines]
    match = _REQUEST.fullmatch(first)
    if match is None or not all(fields):
        raise Refused(HTTPStatus.BAD_REQUEST)
    if match["method"] not in ("GET", "HEAD"):
        raise Refused(HTTPStatus.METHOD_NOT_ALLOWED, "only GET and HEAD")
    headers: dict[str, list[str]] = {}
    for field in filter(None, fields):
        headers.setdefault(field[1].lower(), []).append(field[2].strip())
    try:
        parts = urlsplit(match["target"])
        every = parse_qs(parts.query[:_LONGEST_QUERY], max_num_fields=4) if parts.query else {}
    except ValueError:
        raise Refused(HTTPStatus.BAD_REQUEST) from None
    query = {name: values[0] for name, values in every.items()}
    return Request(match["method"], parts.path, query, headers, match["minor"] == "0" or _ends(headers))


def _ends(headers: Mapping[str, Sequence[str]]) -> bool:
    """Return True if no request can follow: the client closes, or sends a body, which would be parsed as a request."""
    wishes = headers.get("connection", [])
    has_body = headers.get("content-length", ["0"]) != ["0"] or "transfer-encoding" in headers
    return has_body or any("close" in wish.lower() for wish in wishes)


def _is_ours(name: str, host: str, here: str) -> bool:
    """Return True if a Host header names this server: localhost, the bound address, or the address connected to."""
    port = "80"
    if not name.endswith("]") and ":" in name:
        name, _, port = name.rpartition(":")
    name = name.removeprefix("[").removesuffix("]")
    if not port.isdecimal():
        return False
    if name in ("localhost", host):
        return True
    try:
        return ipaddress.ip_address(name) == ipaddress.ip_address(here)
    except ValueError:
        return False
