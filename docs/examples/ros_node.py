"""A ROS 2 node: the first channel of each frame, distance [m] on ~/distance and direction [rad] on ~/direction."""

import math
import sys
import time

import rclpy
import serial
from rclpy.node import Node
from std_msgs.msg import Float32

from firmware_proto import INNER, Decoder


class Receiver(Node):
    def __init__(self, port: str) -> None:
        super().__init__("arva_receiver")
        self._distance = self.create_publisher(Float32, "~/distance", 10)
        self._direction = self.create_publisher(Float32, "~/direction", 10)
        self._port = serial.Serial(port, 115200, timeout=0)
        self._decoder = Decoder()
        self.create_timer(0.05, self.read)

    def read(self) -> None:
        """Publish the frames that have arrived."""
        for frame in self._decoder.feed(self._port.read(4096), time.monotonic()):
            nearest = frame.channels[0]
            if not nearest.valid:  # no signal: publish nothing, so that no old value is used
                continue
            self._distance.publish(Float32(data=nearest.d / 100))
            if nearest.zone != INNER:  # δ is not valid in the inner zone
                self._direction.publish(Float32(data=math.radians(nearest.delta)))


def main() -> None:
    rclpy.init()
    rclpy.spin(Receiver(sys.argv[1]))


if __name__ == "__main__":
    main()
