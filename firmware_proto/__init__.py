"""A codec for the frames between an ARVA receiver and its host, as specified in PROTOCOL.md.

Its section "What a reading means" explains d and δ, and the use of a frame.
"""

from firmware_proto.binary import MAX_FRAME_BYTES, Decoder, encode
from firmware_proto.commands import Command, CommandAnswer, HostForm
from firmware_proto.frame import (
    INNER,
    INTERFERENCE,
    MAX_CHANNELS,
    MID,
    MORE_TRANSMITTERS,
    NO_SIGNAL,
    NOT_SEARCHING,
    OUTER,
    OVERLAP,
    SELF_TEST_FAULT,
    SYNTHETIC,
    Channel,
    Frame,
    FrameDecoder,
    LevelChannel,
    Measured,
    VectorChannel,
)
from firmware_proto.nmea import NmeaDecoder, encode_nmea
from firmware_proto.text import TextDecoder, encode_text
from firmware_proto.wire_format import Format

__all__ = ["INNER", "MAX_CHANNELS", "MAX_FRAME_BYTES", "MID", "NO_SIGNAL", "OUTER"]
__all__ += ["INTERFERENCE", "MORE_TRANSMITTERS", "NOT_SEARCHING", "OVERLAP", "SELF_TEST_FAULT", "SYNTHETIC"]
__all__ += ["Channel", "Decoder", "Format", "Frame", "FrameDecoder", "NmeaDecoder", "TextDecoder"]
__all__ += ["Command", "CommandAnswer", "HostForm", "LevelChannel", "Measured", "VectorChannel"]
__all__ += ["encode", "encode_nmea", "encode_text"]
