"""What make_vectors.py writes. Nothing here imports a codec: bytes and CRCs are made by hand, a bit at a time, and the
expected output of a decoder is written with each stream, so the file cannot agree with a codec by construction.
"""
