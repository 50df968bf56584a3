"""The declarations are ROS 2's own messages, and their bytes are read by a reader that others wrote."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import get_types_from_msg

from arva_hil.records.ros_messages.cdr import encode
from arva_hil.records.ros_messages.message import FieldType, Message, definition, field_types, schema
from arva_hil.records.ros_messages.types import PUBLISHED, Arva, ArvaData, Header, KeyValue, Point, Time
from tests.every import every

from .oracle import JAZZY, OURS, messages, plain, read

EVERY = list(dict.fromkeys(one for published in PUBLISHED for one in messages(published)))
# what a byte from 128 on is, readers do not agree
WHOLE = {"byte": 7, "uint8": 8, "uint16": 16, "uint32": 32}
SIGNED = {"int8": 8, "int32": 32}


def values(of: FieldType) -> st.SearchStrategy[Any]:
    """Whatever a field can hold."""
    if of.message:
        one = build(of.message)
    elif of.name == "string":
        one = st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=9)
    elif of.name == "bool":
        one = st.booleans()
    elif of.name in WHOLE:
        one = st.integers(0, 2 ** WHOLE[of.name] - 1)
    elif of.name in SIGNED:
        bits = SIGNED[of.name] - 1
        one = st.integers(-(2**bits), 2**bits - 1)
    else:
        one = st.floats(width=32 if of.name == "float32" else 64)
    if of.name == "uint8" and of.sequence:
        return st.binary(max_size=9)
    if of.sequence or of.length:
        return st.lists(one, min_size=of.length, max_size=of.length or 3)
    return one


def build(cls: type[Message]) -> st.SearchStrategy[Message]:
    return st.builds(cls, **{name: values(of) for name, of in field_types(cls).items()})


@every("cls", EVERY)
def test_a_declaration_is_the_message_of_ros_2_field_by_field(cls: type[Message]) -> None:
    name = cls.ros_name()
    if cls.package == "arva_msgs":
        assert name not in JAZZY.fielddefs
    else:
        assert OURS.fielddefs[name][1] == JAZZY.fielddefs[name][1]
        assert OURS.hash_rihs01(name) == JAZZY.hash_rihs01(name)


@pytest.mark.parametrize("cls", PUBLISHED, ids=lambda cls: cls.ros_name())
def test_a_schema_has_every_definition_that_it_needs_once(cls: type[Message]) -> None:
    parts = schema(cls).split("=" * 80 + "\nMSG: ")
    assert parts[0] == definition(cls)
    named = [part.partition("\n")[0] for part in parts[1:]]
    assert sorted(named) == sorted(one.ros_name().replace("/msg/", "/") for one in messages(cls)[1:])
    assert set(get_types_from_msg(schema(cls), cls.ros_name())) == {one.ros_name() for one in messages(cls)}


@given(st.data())
@pytest.mark.parametrize("cls", PUBLISHED, ids=lambda cls: cls.ros_name())
def test_whatever_a_message_holds_another_reader_reads(cls: type[Message], data: st.DataObject) -> None:
    message = data.draw(build(cls))
    assert read(encode(message), cls.ros_name()) == plain(message)


@given(build(Arva))
def test_padding_is_zero_and_nothing_follows_the_last_value(message: Message) -> None:
    data = encode(message)
    name = message.ros_name()
    assert data == bytes(OURS.serialize_cdr(OURS.deserialize_cdr(data, name), name))


def test_the_bytes_of_a_known_message() -> None:
    """By hand: the header, then each value on a multiple of its size from there."""
    message = Header(Time(1, 2), "map")
    assert encode(message).hex(" ", 4) == "00010000 01000000 02000000 04000000 6d617000"
    assert encode(Point(1.0, 0.0, -1.0)).hex() == "00010000" + "000000000000f03f" + "00" * 8 + "000000000000f0bf"


def test_texts_that_no_message_can_hold_are_marked_and_do_not_break_it() -> None:
    read_back = read(encode(KeyValue("a\0b", "\udcff")), KeyValue.ros_name())
    assert read_back == {"key": "a\ufffdb", "value": "?"}


def test_the_package_for_ros_2_has_the_same_messages() -> None:
    folder = Path(__file__).parents[3] / "tools" / "ros2" / "arva_msgs" / "msg"
    assert sorted(path.stem for path in folder.glob("*.msg")) == ["Arva", "ArvaData"]
    for cls in (Arva, ArvaData):
        lines = (folder / f"{cls.__name__}.msg").read_text().splitlines()
        fields = [line.partition("#")[0].strip() for line in lines]
        assert "".join(f"{field}\n" for field in fields if field) == definition(cls)
