"""Events and others are frozen dataclasses, though they are defined without the standard decorator."""

from __future__ import annotations

import inspect
from dataclasses import FrozenInstanceError, InitVar, asdict, field, fields, is_dataclass, replace

import pytest

from arva_hil.events import LinkBack, LinkEvent, LinkLost
from arva_hil.frozen import Frozen


class Base(Frozen):
    """One field."""

    first: float


class Derived(Base):
    """One more, and one with a default."""

    second: str
    third: tuple[int, ...] = ()


def test_fields_are_those_of_the_bases_first() -> None:
    assert is_dataclass(Derived)
    assert [field.name for field in fields(Derived)] == ["first", "second", "third"]
    assert asdict(Derived(1.0, "two")) == {"first": 1.0, "second": "two", "third": ()}


def test_fields_are_given_by_place_or_by_name() -> None:
    made = Derived(1.0, "two", (3,))
    assert made == Derived(first=1.0, third=(3,), second="two")
    assert (made.first, made.second, made.third) == (1.0, "two", (3,))


def test_replace_makes_another_one() -> None:
    made = Derived(1.0, "two")
    assert replace(made, third=(3,)) == Derived(1.0, "two", (3,))
    assert made == Derived(1.0, "two")


def test_equal_are_only_those_of_one_class_and_their_hashes_are_equal() -> None:
    assert Derived(1.0, "two") == Derived(1.0, "two")
    assert hash(Derived(1.0, "two")) == hash(Derived(1.0, "two"))
    assert Derived(1.0, "two") != Derived(1.0, "three")
    lost, back = LinkLost(1.0, "autopilot", "pty", "gone"), LinkBack(1.0, "autopilot", "pty", 2.0)
    assert len({lost, back, replace(lost)}) == 2
    assert isinstance(lost, LinkEvent)


def test_its_signature_has_the_fields() -> None:
    assert str(inspect.signature(Derived)) == "(first: 'float', second: 'str', third: 'tuple[int, ...]' = ())"


class Checked(Frozen):
    """With all that a dataclass may have besides."""

    low: float
    high: float = field(kw_only=True)
    source: str = field(default="", compare=False)
    width: InitVar[float | None] = field(default=None, kw_only=True)

    def __post_init__(self, width: float | None) -> None:
        if self.low > self.high:
            raise ValueError("low is above high")
        if width is not None:
            object.__setattr__(self, "high", self.low + width)


def test_values_are_checked_and_those_of_the_constructor_alone_are_not_kept() -> None:
    made = Checked(1.0, "here", high=2.0, width=3.0)
    assert asdict(made) == {"low": 1.0, "high": 4.0, "source": "here"}
    assert made == Checked(1.0, "there", high=4.0)
    with pytest.raises(ValueError, match="above"):
        replace(made, low=5.0, width=None)
    make: type = Checked
    with pytest.raises(TypeError, match="its fields"):
        make(1.0, "here", 2.0)


def test_repr_is_that_of_a_dataclass() -> None:
    assert repr(Derived(1.0, "two")) == "Derived(first=1.0, second='two', third=())"


@pytest.mark.parametrize("name", ["first", "third", "unknown"])
def test_nothing_can_be_set_or_deleted(name: str) -> None:
    made = Derived(1.0, "two")
    with pytest.raises(FrozenInstanceError):
        setattr(made, name, 1)
    with pytest.raises(FrozenInstanceError):
        delattr(made, name)
    assert made == Derived(1.0, "two")


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ((), {}),
        ((1.0,), {}),
        ((1.0, "two", (), 4), {}),
        ((1.0, "two"), {"first": 2.0}),
        ((1.0, "two"), {"fourth": 4}),
        ((1.0,), {"third": ()}),
    ],
)
def test_fields_missing_unknown_or_given_twice_are_refused(
    values: tuple[object, ...], named: dict[str, object]
) -> None:
    make: type = Derived
    with pytest.raises(TypeError, match="Derived"):
        make(*values, **named)
