"""Text from outside in XML: escaped, one line, without characters that XML does not allow."""

from __future__ import annotations

from xml.sax.saxutils import escape

from arva_hil.safe_text import one_line


def text(value: object) -> str:
    """Return a text for the content of an element or an attribute in double quotes."""
    return escape(one_line(value), {'"': "&quot;"})


def element(name: str, value: object) -> str:
    """Return a line with one element."""
    return f"<{name}>{text(value)}</{name}>\n"
