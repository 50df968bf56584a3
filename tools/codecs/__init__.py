"""The codecs in C called from Python, and random streams to compare codecs on."""
