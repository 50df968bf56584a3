"""Read an ARVA receiver's port and print advice for each frame: python client.py /tmp/arva0."""

from __future__ import annotations

import contextlib
import sys
import time

import serial

from firmware_proto import INNER, INTERFERENCE, SELF_TEST_FAULT, Decoder, Frame

LOST_S = 2.0  # without a good frame


def advice(frame: Frame) -> str:
    """Return the advice for a searcher."""
    nearest = frame.channels[0]  # the nearest transmitter comes first
    if frame.status & SELF_TEST_FAULT:
        return "the receiver is broken: do not search with it"
    if not nearest.valid:  # d alone decides whether anything is received
        return "no signal"
    text = f"transmitter {nearest.id}: d {nearest.d / 100:.2f} m"
    if nearest.zone == INNER:  # δ is not valid here
        return f"{text}: go slowly, find the smallest d"
    if frame.status & INTERFERENCE:
        return f"{text}: disturbed, wait for the next reading"
    side = "right" if nearest.delta > 0 else "left"
    return f"{text}: turn {abs(nearest.delta)} degrees {side}, or in the opposite direction"


def main() -> None:
    decoder = Decoder()
    newest_s = time.monotonic()
    with serial.Serial(sys.argv[1], 115200, timeout=0.05) as port:
        while True:
            now = time.monotonic()
            for frame in decoder.feed(port.read(port.in_waiting or 1), now):
                newest_s = now
                print(f"{frame.sequence:3}  {advice(frame)}", flush=True)
            if now - newest_s > LOST_S:
                print("no frames for 2 s: stop where you are", flush=True)
                newest_s = now


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
