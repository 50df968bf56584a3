"""Every public name, and what is public of it, says what it is."""

from __future__ import annotations

import inspect
import re

import arva_hil
import firmware_proto

NUMBERS = re.compile(r"\bfloat\b|NDArray|ArrayLike|\bArray\b")
IN_THE_NAME = re.compile(r"_(m|s|hz|deg|rad|us|ms|cm|m_s)$")
IN_WORDS = re.compile(
    r"\bm\b|\bs\b|\bms\b|\bcm\b|m²|m/s|A/m|µs|°|Hz|dB|metres?\b|seconds?\b|degrees?\b|radians?\b|bytes?\b|ratio|units\b|NED\b"
)
ANY_UNIT = {"Number", "Whole"}  # bounds of a key's value, in the unit of the key

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


def test_every_quantity_has_its_unit_in_its_name_or_in_the_docstring() -> None:
    lacking, names = [], public()
    for name, item in names.items():
        callable_ = inspect.isclass(item) or inspect.isfunction(item) or inspect.ismethod(item)
        raised = inspect.isclass(item) and issubclass(item, Exception)
        if name in ANY_UNIT or raised or not callable_:
            continue
        said = f"{inspect.getdoc(item)} {inspect.getdoc(names[name.partition('.')[0]])}"  # or for a whole class
        for parameter in inspect.signature(item).parameters.values():
            number = NUMBERS.search(str(parameter.annotation))
            if number and not IN_THE_NAME.search(parameter.name) and not IN_WORDS.search(said):
                lacking.append(f"{name}: {parameter.name}")
    assert not lacking, "\n".join(lacking)
