"""An export format: the names of the receivers, a line each, and how many frames they have."""

from __future__ import annotations

from typing import BinaryIO

from arva_hil import Recording


def write(recording: Recording, out: BinaryIO) -> None:
    for receiver in recording.receivers:
        out.write(f"{receiver.name or 'receiver'}: {len(receiver)}\n".encode())
