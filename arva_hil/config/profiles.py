"""The built-in files, and profiles: files whose keys other files take over by `profile: NAME`."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from arva_hil.config import nodes
from arva_hil.config.common import SPEC
from arva_hil.config.errors import Problem, ScenarioError, Violation, any_of
from arva_hil.config.receiver import ReceiverOptions
from arva_hil.config.tables import Given, Table, TableOf, key
from arva_hil.config.transmitter import STRENGTH, KeyingOptions
from arva_hil.errors import nearest

PREFIX: Final = "builtin:"


def builtin_files() -> dict[str, Path]:
    """Return the built-in files by name, sorted; those of campaigns begin with `campaigns/`."""
    package = Path(__file__).resolve().parents[1]
    installed, checkout = package / "configs", package.parent / "configs"
    folder = installed if installed.is_dir() else checkout
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.yaml"))}


def located(path: str | os.PathLike[str]) -> str:
    """Return the path of a scenario: of a built-in one for `builtin:NAME`, else `path` itself. Raises ScenarioError."""
    name = os.fspath(path)
    if not name.startswith(PREFIX):
        return name
    files, wanted = builtin_files(), name.removeprefix(PREFIX)
    if wanted not in files:
        close = nearest(wanted.lower().removesuffix(".yaml"), list(files))
        raise ScenarioError([Problem(name, 1, 1, "no such file is built in", any_of(list(files)), close)])
    return str(files[wanted])


class ReceiverProfile(Table):
    """A file with the properties of a kind of receiver."""

    spec: int = key(SPEC, "the version of this file format")
    receiver: ReceiverOptions = key(help="the keys of a scenario's receiver")

    @classmethod
    def conflicts(cls, of: Any) -> Iterator[Violation]:
        receiver = of.mapping.get("receiver") if isinstance(of, Given) else None
        if isinstance(receiver, Mapping) and "profile" in receiver:
            yield Violation("none in a profile", "profile", path=("receiver", "profile"), at_key=True)


class TransmitterTraits(Table):
    """The properties of a kind of transmitter, without its place."""

    strength: float = key(STRENGTH, "relative to the reference transmitter", default=1.0)
    keying: KeyingOptions | None = key(help="when it sends", default=None)


class TransmitterProfile(Table):
    """A file with the properties of a kind of transmitter."""

    spec: int = key(SPEC, "the version of this file format")
    transmitter: TransmitterTraits = key(help="keys of a scenario's transmitter")


_TABLES: Final[Mapping[str, Any]] = {"receiver": ReceiverProfile, "transmitter": TransmitterProfile}


def profile_kind(text: str) -> str | None:
    """Return the kind of profile of a text, by its keys; None for a scenario and anything else."""
    from arva_hil.config.reading import keys_in  # slow to import

    names = keys_in(text)
    return next((of for of in _TABLES if names == {"spec", of}), None)


def take_over(entry: Any, of: str) -> None:
    """Give a receiver or a transmitter of a file those keys of its profile that it lacks.

    The path of a profile is relative to the file. Raises ScenarioError with the problems of the profile.
    """
    if not isinstance(entry, nodes.Mapping) or not isinstance(name := entry.get("profile"), nodes.Scalar):
        return
    if problem := _missing(name, of):
        raise ScenarioError([problem])
    value = read_profile(name, of)[of]
    _place(value, name.node)
    entry.inherit(value, list(value))


def _missing(name: nodes.Scalar, of: str) -> Problem | None:
    """Return the problem of a profile that does not exist, at the place of its name."""
    built_in = [PREFIX + file.removeprefix(f"{of}s/") for file in builtin_files() if file.startswith(f"{of}s/")]
    path = os.path.join(nodes.folder_of(name), name)
    if name in built_in or (not name.startswith(PREFIX) and os.path.exists(path)):
        return None
    near, expected = nearest(name.lower(), built_in), any_of(built_in)
    if not name.startswith(PREFIX):
        same = PREFIX + name.removesuffix(".yaml")
        near = same if same in built_in else near
        expected = f"a file, or {expected}"
    at = name.node.start_mark
    return Problem(at.name, at.line + 1, at.column + 1, f"no {of} profile {str(name)!r}", expected, near)


def read_profile(name: str, of: str) -> nodes.Mapping:
    """Return the valid mapping in a profile's file. Raises ScenarioError."""
    from arva_hil.config.reading import read_text  # slow to import

    own = str(Path(nodes.folder_of(name)) / name)
    path = located(f"{PREFIX}{of}s/{name.removeprefix(PREFIX)}") if name.startswith(PREFIX) else own
    return parse_profile(read_text(path, f"the profile of a {of}"), of, path)


def parse_profile(text: str, of: str, source: str) -> nodes.Mapping:
    """Return the valid mapping in a profile's text; `source`: its name. Raises ScenarioError."""
    from arva_hil.config.reading import read  # slow to import

    def checked(top: nodes.Value) -> nodes.Mapping:
        TableOf(_TABLES[of]).read(top)
        assert isinstance(top, nodes.Mapping)
        return top

    return read(text, source, f"a mapping with spec, {of}", checked, nodes.NEWEST_SPEC)


def _place(value: nodes.Value, node: Any) -> None:
    """Give a value of another file the place of a node of this one."""
    value.node = node
    if isinstance(value, nodes.Mapping):
        value.key_nodes = dict.fromkeys(value.key_nodes, node)
        for item in value.values():
            _place(item, node)
    elif isinstance(value, nodes.Items):
        for item in value:
            _place(item, node)
