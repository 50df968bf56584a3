"""What a decoder of binary frames must answer, as slowly and plainly as the rules read; and hypothesis frames."""

from hypothesis import strategies as st

from firmware_proto import Channel, Frame

CHANNELS = st.builds(
    Channel,
    id=st.none() | st.integers(0, 254),
    zone=st.integers(0, 2),
    d=st.integers(-0x8000, 0x7FFF),
    delta=st.integers(-0x8000, 0x7FFF),
    marked=st.booleans(),
)
FRAMES = st.builds(
    Frame,
    sequence=st.integers(0, 255),
    status=st.integers(0, 255),
    channels=st.lists(CHANNELS, min_size=1, max_size=16).map(tuple),
    measured=st.none(),
)


def crc(data):
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0x8408 if register & 1 else 0)
    return register


def verdict(data):
    """Of the candidate at data[0]: 0 = refused, 1 = its CRC fails, 2 = not whole, else the frame's size."""
    for at, value in enumerate(data):
        if at < 3 and value != (0xA4, 0x57, 1)[at]:
            return 0
        if at == 3 and value not in {3 + 6 * n for n in range(1, 17)}:
            return 0
        if at == 6 and data[3] != 3 + 6 * value:
            return 0
        if at > 6 and at == 8 + 6 * data[6]:
            return at + 1 if crc(data[2 : at - 1]) == data[at - 1] + 256 * data[at] else 1
    return 2


class Reference:
    """Every byte with its time; a rule at a time."""

    def __init__(self):
        self.held = []
        self.frames = []  # their bytes
        self.dropped = self.bad_crc = 0

    def feed(self, chunk, now):
        before = len(self.frames)
        self._settle(now)
        for byte in chunk:
            self.held.append((byte, now))
            self._settle(now)
        return self.frames[before:]

    def _settle(self, now):
        while self.held:
            found = verdict(bytes(byte for byte, _ in self.held))
            if found == 2 and now - self.held[0][1] < 0.1:
                return
            if found > 2:
                self.frames.append(bytes(byte for byte, _ in self.held[:found]))
                del self.held[:found]
                continue
            self.bad_crc += found == 1
            self.dropped += 1
            del self.held[0]
