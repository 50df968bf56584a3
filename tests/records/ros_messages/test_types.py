"""The receiver's own messages are those of the package for ROS 2, and a reader that others wrote reads their bytes."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from arva_hil.records.ros_messages.types import (
    PUBLISHED,
    STORE,
    Arva,
    ArvaData,
    Header,
    Message,
    Point,
    Time,
    Vector3,
    encode,
    schema,
)
from tests.every import every

from .oracle import plain, read

INT32 = st.integers(-(2**31), 2**31 - 1)
TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=9)
HEADER = st.builds(Header, st.builds(Time, INT32, st.integers(0, 2**32 - 1)), TEXT)
DIRECTION = st.builds(Vector3, st.floats(), st.floats(), st.floats())
SLOT = st.builds(ArvaData, INT32, st.floats(width=32), DIRECTION, INT32, st.integers(0, 255))


@every("cls", PUBLISHED)
def test_a_schema_is_all_that_another_program_needs(cls: type[Message]) -> None:
    theirs = get_typestore(Stores.EMPTY)
    theirs.register(get_types_from_msg(schema(cls), cls.__msgtype__))
    assert theirs.hash_rihs01(cls.__msgtype__) == STORE.hash_rihs01(cls.__msgtype__)


@given(st.builds(Arva, HEADER, st.lists(SLOT, max_size=3)))
def test_whatever_a_reading_holds_another_reader_reads(message: Arva) -> None:
    assert read(encode(message), "arva_msgs/msg/Arva") == plain(message)


def test_the_bytes_of_a_known_message() -> None:
    """By hand: the header, then each value on a multiple of its size from there."""
    assert encode(Header(Time(1, 2), "map")).hex(" ", 4) == "00010000 01000000 02000000 04000000 6d617000"
    assert encode(Point(1.0, 0.0, -1.0)).hex() == "00010000" + "000000000000f03f" + "00" * 8 + "000000000000f0bf"


def test_the_package_for_ros_2_has_the_same_messages() -> None:
    folder = Path(__file__).parents[3] / "tools" / "ros2" / "arva_msgs" / "msg"
    assert sorted(path.stem for path in folder.glob("*.msg")) == ["Arva", "ArvaData"]
    for cls in (Arva, ArvaData):
        lines = (folder / f"{cls.__name__}.msg").read_text().splitlines()
        fields = [line.partition("#")[0].strip() for line in lines]
        assert "".join(f"{field}\n" for field in fields if field) == schema(cls).partition("=")[0]
