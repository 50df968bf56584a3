"""`arva-hil fit`: what is wrong on the command line; test_procedure.py fits."""

from __future__ import annotations

from tests.every import every

from .far_ends import Arva


@every(
    "arguments, what, cure",
    [
        ("fit r", "--out is missing", "--out my_receiver.yaml"),
        ("fit --out p.yaml", "RECORD", "--help"),
        ("fit r --model morse --out p.yaml", "morse", "pulsed"),
        ("fit nowhere --out p.yaml", "no such folder", "--record"),
    ],
)
def test_wrong_words_are_refused(arva: Arva, arguments: str, what: str, cure: str) -> None:
    code, _, err = arva(*arguments.split())
    assert code == 2
    assert what in err
    assert cure in err
