"""What make_vectors.py writes. Nothing here imports a codec: bytes and CRCs are made by hand, a bit at a time, and what
a decoder must answer is written down with each stream, so the file cannot agree with a codec by construction.
"""
