"""A packet of MAVLink, as it was received."""

from __future__ import annotations

from typing import Literal, NamedTuple

Verdict = Literal["", "unsigned", "forged", "replayed"]


class Packet(NamedTuple):
    """One complete packet as it was received. Its checksum is verified if the dialect knows the message id."""

    raw: bytes
    version: int  # 1 or 2
    signed: bool
    system: int
    component: int
    msgid: int
    known: bool  # the dialect can decode it
    refused: Verdict = ""  # the reason why its signature is not valid; "" also on a link without a key
