"""A wire format: what encodes and decodes its frames, and what they carry."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from firmware_proto.commands import HostForm
from firmware_proto.frame import Frame, FrameDecoder


class Format(NamedTuple):
    """A wire format: its encoder and its decoder.

    `encode` raises ValueError for a frame that does not fit. `decoder` makes a decoder for one stream of bytes.

    - `numbered`: the bytes contain the frame's sequence number and status.
    - `host`: the format of commands and answers on the same port; None if the receiver takes none.
    - `ids`: the bytes contain the ids of transmitters, so that several drones can search together.
    - `measured`: the measured values that the bytes contain: "vector", "level", or "" for none.
    """

    encode: Callable[[Frame], bytes]
    decoder: Callable[[], FrameDecoder]
    numbered: bool = False
    host: HostForm | None = None
    ids: bool = False
    measured: str = ""
