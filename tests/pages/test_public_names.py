"""Every public name, and what is public of it, says what it is."""

from __future__ import annotations

import inspect

import arva_hil
import firmware_proto

STRUCTURES = {"ReceiverSettings"}  # their docstring says what each of their values is


def public() -> dict[str, object]:
    """Names and their objects, and those of the public functions and properties of classes."""
    found: dict[str, object] = {}
    for package in (arva_hil, firmware_proto):
        for name in package.__all__:
            item = getattr(package, name)
            if not callable(item):
                continue
            found[name] = item
            if inspect.isclass(item) and name not in STRUCTURES:
                for part, value in vars(item).items():
                    function = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
                    if not part.startswith("_") and inspect.isfunction(function):
                        found[f"{name}.{part}"] = getattr(item, part)
    return found


def test_every_public_name_has_a_docstring() -> None:
    names = public()
    assert len(names) > 80
    assert [name for name, item in names.items() if not inspect.getdoc(item)] == []


def test_a_structure_says_in_its_docstring_what_each_of_its_values_is() -> None:
    for name in STRUCTURES:
        item = getattr(arva_hil, name)
        said = inspect.getdoc(item) or ""
        assert [part for part in vars(item) if not part.startswith("_") and f"`{part}`" not in said] == []
