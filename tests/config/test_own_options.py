"""Own keys of plug-ins: their constraints are the annotations of a dataclass, in files, in Python and in schemas."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
import yaml
from annotated_types import Ge, Gt, Interval, Lt

from arva_hil.config.constraints import ListOf
from arva_hil.config.errors import ConstraintError
from arva_hil.config.nodes import value_of
from arva_hil.config.own_options import own_keys
from arva_hil.config.tables import own_options, read_own
from arva_hil.errors import KindError
from tests.every import every


class Colour(Enum):
    RED = "red"


@dataclass
class Unread:
    typed: Nowhere  # type: ignore[name-defined]  # noqa: F821


@dataclass(frozen=True)
class Options:
    needed: int
    flag: bool = False
    whole: Annotated[int, Interval(ge=1, lt=10)] = 1
    share: Annotated[float | None, Gt(0), Lt(1)] = None
    late: Annotated[float, Ge(0)] | None = None
    label: str = "none"
    one_of: Literal["a", "b"] = "a"
    antennas: Literal[1, 2, 3] = 3
    pair: tuple[float, float] = (1.0, 2.0)
    rows: tuple[tuple[int, int], ...] = ()
    names: list[str] = field(default_factory=list)
    file: Path = Path("here")
    colour: Colour = Colour.RED

    def __post_init__(self) -> None:
        if self.label == "bad":
            raise ValueError("label bad: expected a good one")


def read(text: str) -> tuple[Any, list[str]]:
    options, violations = read_own(Options, value_of(yaml.compose(f"{{needed: 1, {text}}}", yaml.BaseLoader), 2), "it")
    return options, [f"{'.'.join(map(str, one.path))} {one.found or ''}, {one.expected}" for one in violations]


@every(
    "text, name, value",
    [
        *(
            (f"flag: {text}", "flag", value)
            for text, value in (("true", True), ("off", False), ("Yes", True), ("0", False))
        ),
        *(
            ("whole: 9", "whole", 9),
            ("whole: 9.0", "whole", 9),
            ("share: 1e-3", "share", 0.001),
            ("share: ~", "share", None),
        ),
        *(
            ("late: 3", "late", 3.0),
            ("label: 5", "label", "5"),
            ("one_of: b", "one_of", "b"),
            ("antennas: 2", "antennas", 2),
        ),
        *(("pair: [3, 4.5]", "pair", (3.0, 4.5)), ("rows: [[1, 2], [3, 4]]", "rows", ((1, 2), (3, 4)))),
        *(
            ("names: [x, 'y']", "names", ["x", "y"]),
            ("file: a/b", "file", Path("a/b")),
            ("colour: red", "colour", Colour.RED),
        ),
    ],
)
def test_a_key_of_a_file_is_the_type_that_is_annotated(text: str, name: str, value: object) -> None:
    options, wrong = read(text)
    assert wrong == []
    assert getattr(options, name) == value
    assert type(getattr(options, name)) is type(value)


@every(
    "text, expected",
    [
        ("flag: maybe", ["flag , a valid boolean"]),
        ("whole: 1.5, share: x", ["whole , a valid integer", "share , a valid number"]),
        ("whole: 0", ["whole , greater than or equal to 1"]),
        ("whole: 10", ["whole , less than 10"]),
        ("share: 0", ["share , greater than 0"]),
        ("late: -1", ["late , greater than or equal to 0"]),
        ("late: 1e999, pair: [1, -1e999]", ["late , a finite number", "pair.1 , a finite number"]),
        ("label: [1]", ["label , a valid string"]),
        ("one_of: c", ["one_of , 'a' or 'b'"]),
        ("antennas: 4", ["antennas , 1, 2 or 3"]),
        ("pair: [1]", ["pair , a list of 2"]),
        ("rows: [[1, x], 3]", ["rows.0.1 , a valid integer", "rows.1 , a valid tuple"]),
        ("names: x", ["names , a valid list"]),
        ("colour: blue", ["colour , a valid Colour"]),
        ("label: bad", [" label bad, a good one"]),
    ],
)
def test_a_wrong_key_of_a_file_is_named(text: str, expected: list[str]) -> None:
    assert read(text) == (None, expected)


def test_an_error_without_words_is_one_of_the_mapping() -> None:
    @dataclass(frozen=True)
    class Silent:
        share: float = 1.0

        def __post_init__(self) -> None:
            raise ValueError

    (only,) = read_own(Silent, value_of(yaml.compose("{share: 2}", yaml.BaseLoader), 2), "it")[1]
    assert (only.found, only.expected) == (None, "what it takes")


def test_without_a_default_a_key_is_needed_and_python_may_give_options_or_a_mapping() -> None:
    (missing,) = read_own(Options, value_of(yaml.compose("{}", yaml.BaseLoader), 2), "it")[1]
    assert (missing.found, missing.expected) == ("no needed", "a mapping with needed")
    assert own_options(Options, {"needed": 2, "share": 0.5}, "it") == Options(2, share=0.5)
    assert own_options(Options, made := Options(3), "it") is made
    assert own_options(None, None, "it") is None
    for cls, options, why in (
        (Options, {"needed": "x"}, "needed: 'x', expected a valid integer"),
        (Options, {"neded": 1}, "options: 'neded', expected one of needed, flag"),
        (Options, 5, "options: 5, expected Options or a mapping"),
        (None, {"a": 1}, "expected None: it has no keys of its own"),
    ):
        with pytest.raises(ValueError, match=why):
            own_options(cls, options, "it")
    with pytest.raises(KindError, match="ListOf are no dataclass"):
        own_keys(ListOf)
    with pytest.raises(KindError, match="the Options 7 are no dataclass"):
        own_keys(7)  # type: ignore[arg-type]
    with pytest.raises(KindError, match="Unread have an annotation that cannot be read"):
        own_keys(Unread)
    assert issubclass(ConstraintError, ValueError)


def test_the_schema_of_each_key() -> None:
    schemas = {name: one.json() for name, one in own_keys(Options).items()}
    assert (
        schemas
        | {
            "needed": {"type": "integer"},
            "whole": {"type": "integer", "minimum": 1, "exclusiveMaximum": 10, "default": 1},
            "share": {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1},
            "late": {"type": "number", "minimum": 0},
            "one_of": {"enum": ["a", "b"], "type": "string", "default": "a"},
            "pair": {
                "type": "array",
                "minItems": 2,
                "maxItems": 2,
                "prefixItems": [{"type": "number"}] * 2,
                "default": [1.0, 2.0],
            },
            "names": {"type": "array", "items": {"type": "string"}},
        }
        == schemas
    )
