"""A driver for an ARVA receiver. It has a mistake, which test_my_driver.py finds."""

from typing import Any

from firmware_proto import Decoder


class Driver:
    """Remembers the distance in metres to the nearest transmitter; None without a signal."""

    def __init__(self, port: Any) -> None:
        self.distance_m: float | None = None
        self._port = port
        self._decoder = Decoder()

    def update(self, now_s: float) -> None:
        """Read the port, often."""
        for frame in self._decoder.feed(self._port.read(4096), now_s):
            heard = [channel.d for channel in frame.channels if channel.d > 0]
            if heard:
                self.distance_m = min(heard) / 100
