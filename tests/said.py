"""What a text has to say."""

from __future__ import annotations

from collections.abc import Container


def says(text: Container[str], *parts: str) -> None:
    """Each of these parts is in the text; those that are missing are named."""
    assert [part for part in parts if part not in text] == [], text
