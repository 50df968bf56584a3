"""The figures of the house stay where they are: the engine's face, and the length of the ways through it."""

from __future__ import annotations

import ast
import functools
from collections import Counter
from itertools import pairwise

from arva_hil.emulator.engine import Emulator
from tools.bench import house


@functools.cache
def _nodes() -> list[tuple[str, ast.AST]]:
    """Modules, statements, exception handlers and conditional expressions, and where they are."""
    return [
        (f"{module}:{getattr(node, 'lineno', 1)}", node)
        for folder in ("arva_hil", "firmware_proto")
        for module, tree in house.modules(folder).items()
        for node in ast.walk(tree)
        if isinstance(node, ast.mod | ast.stmt | ast.ExceptHandler | ast.match_case | ast.IfExp)
    ]


def test_the_engine_has_few_methods_and_every_class_few_attributes() -> None:
    assert sorted(name for name in vars(Emulator) if not name.startswith("_")) == sorted(
        ["receive", "advance", "output", "written", "events", "next_deadline", "link_lost", "link_back"]
    )
    assert {name: count for name, count in house.classes() if count > 12} == {}


def test_the_ways_through_the_house_grow_no_longer() -> None:
    packet, transmitter, frame = house.packet_to_frame(), house.transmitter_to_field(), house.frame_to_set_point()
    assert len(packet.calls) <= 77, str(packet)
    assert packet.files <= 17, str(packet)
    assert packet.changes <= 39, str(packet)
    assert len(frame.calls) <= 180, str(frame)
    assert frame.files <= 25, str(frame)
    assert len(transmitter.calls) <= 120, str(transmitter)
    assert transmitter.files <= 12, str(transmitter)


def test_no_two_rooms_import_each_other_and_no_modules_do_in_a_circle() -> None:
    imported = house.arrows(house.modules("arva_hil"))
    assert house.circle(imported) == []
    assert house.circle(house.arrows(house.modules("firmware_proto"))) == []
    assert house.circle(house.rooms(imported)) == []


def test_no_two_classes_have_one_name() -> None:
    named = [(node.name, at) for at, node in _nodes() if isinstance(node, ast.ClassDef)]
    times = Counter(name for name, _ in named)
    assert [(name, at) for name, at in named if times[name] > 1] == []


def test_no_function_has_more_than_fifty_lines() -> None:
    lengths = {
        f"{at} {node.name}": (node.end_lineno or 0) - node.lineno + 1
        for at, node in _nodes()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    assert {name: length for name, length in lengths.items() if length > 50} == {}


def test_no_statement_shares_its_line() -> None:
    blocks = [
        (at, block)
        for at, node in _nodes()
        for name in ("body", "orelse", "finalbody")
        if isinstance(block := getattr(node, name, None), list)
    ]
    shared = [at for at, block in blocks for a, b in pairwise(block) if a.end_lineno == b.lineno]
    assert shared == []


def test_no_conditional_expression_holds_another() -> None:
    nested = [
        at
        for at, node in _nodes()
        if isinstance(node, ast.IfExp) and sum(isinstance(n, ast.IfExp) for n in ast.walk(node)) > 1
    ]
    assert nested == []
