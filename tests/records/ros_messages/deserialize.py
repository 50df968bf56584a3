"""Reads the messages of an MCAP file by ROS 2's own type support, and prints what they say as JSON."""

from __future__ import annotations

import importlib
import json
import sys
from collections import Counter

from mcap.reader import make_reader
from rclpy.serialization import deserialize_message


def main(path: str) -> None:
    counts: Counter[str] = Counter()
    left_out: set[str] = set()
    readings = []
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            package, _, name = schema.name.partition("/msg/")
            try:
                kind = getattr(importlib.import_module(f"{package}.msg"), name)
            except ImportError:
                left_out.add(package)
                continue
            told = deserialize_message(message.data, kind)
            counts[channel.topic] += 1
            if channel.topic == "/arva":
                readings.append([(s.id, s.distance, s.delta, s.zone) for s in told.arva_signals])
    print(json.dumps({"readings": readings, "counts": counts, "left_out": sorted(left_out)}))


if __name__ == "__main__":
    main(sys.argv[1])
