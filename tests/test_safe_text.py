"""Text from outside that is shown: nothing of it is an order to a terminal, a second line, or a formula."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.safe_text import cell, one_line


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("d 1234 cm +17° … → 'ok'", "d 1234 cm +17° … → 'ok'"),
        ("\x1b]0;title\x07", r"\x1b]0;title\x07"),
        ("\x1b[2J\rgone", r"\x1b[2J\rgone"),
        ("one\ntwo\r\nthree\x0b\x0c\x85\u2028\u2029", r"one\ntwo\r\nthree\x0b\x0c\x85\u2028\u2029"),
        ("\x9b31m\x7f\0", r"\x9b31m\x7f\x00"),
        ("a\u202eb\u2066c\u200f\u200b\ufeff", r"a\u202eb\u2066c\u200f\u200b\ufeff"),
        ("name\udcff\ud800", r"name\udcff\ud800"),
        ("\U000e0001\ue000", r"\U000e0001\ue000"),
    ],
)
def test_what_is_not_printable_is_escaped(text: str, shown: str) -> None:
    assert one_line(text) == shown


@given(st.text(st.characters(exclude_categories=())))
def test_every_text_is_one_printable_line(text: str) -> None:
    shown = one_line(text)
    assert shown.isprintable()
    assert one_line(shown) == shown
    assert shown.encode().decode() == shown


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", " =1", "\t=1", "\r=1", "\n@a"])
def test_a_cell_is_no_formula(text: str) -> None:
    assert cell(text)[0] not in "=+-@"
    assert cell(text).endswith(one_line(text))
    assert "\n" not in cell(text)


def test_a_harmless_cell_stays_as_it_is() -> None:
    assert cell("configs/paper_case_1.yaml") == "configs/paper_case_1.yaml"
