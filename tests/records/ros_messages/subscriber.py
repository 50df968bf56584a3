"""Subscribes to /arva by rclpy, and prints all readings as JSON when nothing has come for two seconds."""

from __future__ import annotations

import json
import time

import rclpy
from arva_msgs.msg import Arva

_WAIT_S = 60.0
_PAUSE_S = 2.0


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("arva_hil_test")
    readings: list[list[tuple[float, ...]]] = []
    last = time.monotonic() + _WAIT_S

    def take(message: Arva) -> None:
        nonlocal last
        last = time.monotonic()
        readings.append([(slot.id, slot.distance, slot.delta, slot.zone) for slot in message.arva_signals])

    node.create_subscription(Arva, "/arva", take, 1000)
    print("ready", flush=True)
    while time.monotonic() < last + _PAUSE_S:
        rclpy.spin_once(node, timeout_sec=0.1)
    print(json.dumps(readings))


if __name__ == "__main__":
    main()
