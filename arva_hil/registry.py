"""Receiver models, wire formats, links, faults, strategies, observers and commands by name.

The built-in ones are listed here, one line each, and imported when they are first used. Other packages add their own
with entry points, which are read only for names that are not built in.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from importlib.machinery import PathFinder
from typing import TYPE_CHECKING, Any, Final

from arva_hil.errors import KindError, UnknownKindError, nearest

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


class Registry:
    """Finds kinds by name, and keeps those that it found in `loaded`. Iterating gives the built-in names.

    - `what`: the word for one kind, e.g. "fault".
    - `group`: the group of entry points of other packages.
    - `built_in`: `module:attribute` by name; other packages cannot replace these.
    - `requires`: attributes that each kind must have; "new or old" requires one of the two.
    - `references`: True if `module:attribute` is a valid name too.
    - `made_with`: arguments with which an object of a class is made, to check its `attributes`.
    - `attributes`: attributes that each object of a class must have.
    """

    def __init__(  # no dataclass: its import takes a tenth of the time of --help
        self,
        what: str,
        group: str,
        built_in: Mapping[str, str],
        requires: Sequence[str] = (),
        *,
        references: bool = False,
        made_with: Sequence[Any] = (),
        attributes: Sequence[str] = (),
    ) -> None:
        self.what = what
        self.group = group
        self.built_in = built_in
        self.requires = requires
        self.references = references
        self.made_with = made_with
        self.attributes = attributes
        self.loaded: dict[str, Any] = {}

    def __len__(self) -> int:
        return len(self.built_in)

    def __iter__(self) -> Iterator[str]:
        return iter(self.built_in)

    def __contains__(self, name: object) -> bool:
        """Return True if there is a kind of that name. It may be broken."""
        return name in self.built_in or name in self.loaded or bool(self._entries(str(name)))

    def __getitem__(self, name: str) -> Any:
        """Return the kind of that name. Raises KindError if there is none, more than one, or an unusable one."""
        if name not in self.loaded:
            if name in self.built_in:
                module, _, attribute = self.built_in[name].partition(":")
                self.loaded[name] = getattr(importlib.import_module(module), attribute)
            elif self.references and ":" in name:
                self.loaded[name] = self._reference(name)
            else:
                self.loaded[name] = self._plug_in(name)
        return self.loaded[name]

    def names(self) -> list[str]:
        """Return all names: the built-in ones, then those of other packages."""
        return list(dict.fromkeys([*self.built_in, *sorted(entry.name for entry in self._entries())]))

    def packages(self) -> dict[str, str]:
        """Return the package of each kind that is not built in, by name. Imports none of them."""
        others = sorted((entry.name, _package(entry)) for entry in self._entries())
        return {name: package for name, package in others if name not in self.built_in}

    def _entries(self, name: str | None = None) -> list[EntryPoint]:
        from importlib.metadata import entry_points  # slow to import

        found = entry_points(group=self.group)
        return list(found if name is None else found.select(name=name))

    def _plug_in(self, name: str) -> Any:
        if not (entries := self._entries(name)):
            raise self._unknown(name)
        packages = [_package(one) for one in entries]
        if len(entries) > 1:
            raise KindError(
                f"{self.what} {name!r} is in {len(entries)} packages, {' and '.join(packages)}", "uninstall one of them"
            )
        try:
            thing = entries[0].load()
        except (Exception, SystemExit) as error:
            raise self._broken(name, packages[0], f"cannot be imported ({_said(error)})") from error
        if why := self._unfit(thing):
            raise self._broken(name, packages[0], why)
        return thing

    def _reference(self, name: str) -> Any:
        """Import `module:attribute`; modules in the current folder are found too."""
        module, _, attribute = name.partition(":")
        if not all(part.isidentifier() for part in (*module.split("."), *attribute.split("."))):
            raise KindError(f"{self.what} {name!r} is no name of a class", "write MODULE:CLASS, e.g. my_search:Spiral")
        try:
            with ExitStack() as stack:
                sys.path.append("")
                stack.callback(sys.path.remove, "")
                if len(files := _files(module.partition(".")[0])) > 1:
                    raise KindError(
                        f"{self.what} {name!r}: there are {len(files)} modules of that name, {' and '.join(files)}",
                        "rename yours, or take the other one out of PYTHONPATH",
                    )
                thing = importlib.import_module(module)
        except (Exception, SystemExit) as error:
            missing = error.name if isinstance(error, ModuleNotFoundError) else None
            if missing and f"{module}.".startswith(f"{missing}."):
                raise KindError(
                    f"{self.what} {name!r}: there is no module {missing}", "install it, or run this where the file is"
                ) from None
            raise KindError(
                f"{self.what} {name!r} cannot be imported ({_said(error)})", "fix the error and try again"
            ) from error
        for part in attribute.split("."):
            if not hasattr(thing, part):
                near = nearest(part, dir(thing))
                raise KindError(f"{self.what} {name!r}: {module} has no {part}", "write MODULE:CLASS", near)
            thing = getattr(thing, part)
        if why := self._unfit(thing):
            raise KindError(f"{self.what} {name!r} {why}", "fix the error and try again")
        return thing

    def _unfit(self, thing: Any) -> str:
        """Return the reason why `thing` cannot be used as such a kind; "" if it can."""
        missing = [name for name in self.requires if not any(_has(thing, one) for one in name.split(" or "))]
        if self.attributes and not missing:
            import inspect  # slow to load, and needed for classes only

            needed = [one for name in self.requires for one in name.split(" or ") if hasattr(thing, one)]
            if never := [name for name in needed if inspect.iscoroutinefunction(getattr(thing, name))]:
                return f"has async {', '.join(never)}; write def, not async def"
            try:
                made = thing(*self.made_with)
                missing = [name for name in self.attributes if not hasattr(made, name)]
            except (Exception, SystemExit) as error:
                return f"cannot be created ({_said(error)})"
        return f"lacks {', '.join(missing)}" if missing else ""

    def _unknown(self, name: str) -> UnknownKindError:
        names = self.names()
        there = f"there {'are' if len(names) > 1 else 'is'} {', '.join(names) or 'none'}"
        if self.references:
            there += ", or MODULE:CLASS"
        near = nearest(name.lower(), names)
        if self.references and near is None and "." in name:
            near = ":".join(name.rsplit(".", 1))  # MODULE.CLASS in place of MODULE:CLASS
        return UnknownKindError(f"no {self.what} {name!r}", there, near)

    def _broken(self, name: str, package: str, why: str) -> KindError:
        cure = f"update that package, or uninstall it: pip uninstall {package.partition(' ')[0]}"
        return KindError(f"{self.what} {name!r} of the package {package} {why}", cure)


def _package(entry: EntryPoint) -> str:
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.value


def _files(module: str) -> list[str]:
    """Return the files of all modules or packages of that name, in Python's order of search; none for arva_hil."""
    if module == "arva_hil":
        return []
    folders = dict.fromkeys(folder or os.getcwd() for folder in sys.path)
    specs = (PathFinder.find_spec(module, [folder]) for folder in folders)
    return list(dict.fromkeys(os.path.realpath(spec.origin) for spec in specs if spec and spec.origin))


def _has(thing: Any, name: str) -> bool:
    """Return True if `thing` defines an attribute. Abstract attributes, and those of a protocol, do not count."""
    if not isinstance(thing, type):
        return hasattr(thing, name)
    owner = next((cls for cls in thing.__mro__ if name in {*vars(cls), *vars(cls).get("__annotations__", ())}), None)
    abstract = name in getattr(thing, "__abstractmethods__", ())
    return owner is not None and not abstract and not vars(owner).get("_is_protocol", False)


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"


RECEIVERS: Final = Registry(
    "receiver model",
    "arva_hil.receivers",
    {
        "paper": "arva_hil.model.receiver.paper:PaperReceiver",
        "pulsed": "arva_hil.model.receiver.pulsed:PulsedReceiver",
        "rssi": "arva_hil.model.receiver.rssi:RssiReceiver",
        "vector": "arva_hil.model.receiver.pulsed:VectorReceiver",
    },
    ("from_settings", "next_look", "look", "show", "command"),
)
FORMATS: Final = Registry(
    "format",
    "arva_hil.formats",
    {
        "binary": "firmware_proto.binary:BINARY",
        "nmea": "firmware_proto.nmea:NMEA",
        "text": "firmware_proto.text:TEXT",
        "handheld": "firmware_proto.handheld:HANDHELD",
        "vector": "firmware_proto.measured:VECTOR",
        "rssi": "firmware_proto.measured:RSSI",
        "tunnel": "arva_hil.emulator.formats:TUNNEL",
        "named": "arva_hil.emulator.formats:NAMED",
        "named_float": "arva_hil.emulator.formats:NAMED_FLOAT",
        "debug_vect": "arva_hil.emulator.formats:DEBUG_VECT",
    },
    ("encode", "decoder", "numbered"),
)
MAVLINK_FORMATS: Final = ("tunnel", "named", "named_float", "debug_vect")
"""Built-in formats that go over the autopilot's link, named here because importing them is slow."""


def over_mavlink(format: str) -> bool:
    """Return True if a format goes over the autopilot's link; all others are sent to a port."""
    if format in FORMATS.built_in:
        return format in MAVLINK_FORMATS
    return bool(getattr(FORMATS[format], "over_mavlink", False))


def formats_with_ids() -> list[str]:
    """Return the formats of ports whose frames contain the ids of transmitters."""
    return [name for name in FORMATS.names() if not over_mavlink(name) and getattr(FORMATS[name], "ids", False)]


FAULTS: Final = Registry(
    "fault",
    "arva_hil.faults",
    {  # in the order in which they are applied; those of other packages come last
        "transmitter_off": "arva_hil.emulator.faults.hearing:OFF",
        "transmitter_moved": "arva_hil.emulator.faults.hearing:MOVED",
        "transmitter_fading": "arva_hil.emulator.faults.hearing:FADING",
        "interference": "arva_hil.emulator.faults.hearing:INTERFERENCE",
        "antenna_x": "arva_hil.emulator.faults.hearing:ANTENNA_X",
        "antenna_y": "arva_hil.emulator.faults.hearing:ANTENNA_Y",
        "antenna_z": "arva_hil.emulator.faults.hearing:ANTENNA_Z",
        "cold_battery_db": "arva_hil.emulator.faults.hearing:COLD",
        "saturation_na_m": "arva_hil.emulator.faults.hearing:SATURATION",
        "electronics_na_m": "arva_hil.emulator.faults.hearing:ELECTRONICS",
        "stuck": "arva_hil.emulator.faults.hearing:STUCK",
        "silence": "arva_hil.emulator.faults.sending:SILENCE",
        "drop": "arva_hil.emulator.faults.sending:DROP",
        "self_test": "arva_hil.emulator.faults.sending:SELF_TEST",
        "impulses": "arva_hil.emulator.faults.sending:IMPULSES",
        "sequence": "arva_hil.emulator.faults.sending:SEQUENCE",
        "duplicate": "arva_hil.emulator.faults.sending:DUPLICATE",
        "delay_s": "arva_hil.emulator.faults.sending:DELAY",
        "jitter_s": "arva_hil.emulator.faults.sending:JITTER",
        "reorder": "arva_hil.emulator.faults.sending:REORDER",
        "truncate": "arva_hil.emulator.faults.sending:TRUNCATE",
        "corrupt": "arva_hil.emulator.faults.sending:CORRUPT",
        "drop_bytes": "arva_hil.emulator.faults.sending:DROP_BYTES",
        "insert_bytes": "arva_hil.emulator.faults.sending:INSERT_BYTES",
        "flip_bytes": "arva_hil.emulator.faults.sending:FLIP_BYTES",
        "baud_ratio": "arva_hil.emulator.faults.sending:BAUD_RATIO",
    },
    ("stage", "valid", "help", "strike", "needs"),
)
LINKS: Final = Registry(  # by an address's kind; for links of other packages this is its scheme
    "kind of link",
    "arva_hil.links",
    {
        "serial": "arva_hil.links.serial:SerialLink",
        "pyserial": "arva_hil.links.serial:PyserialLink",
        "pty": "arva_hil.links.pty:PtyLink",
        "udpin": "arva_hil.links.udp:UdpInLink",
        "udpout": "arva_hil.links.udp:UdpOutLink",
        "tcp": "arva_hil.links.tcp:TcpLink",
        "tcpin": "arva_hil.links.tcp:TcpServerLink",
        "tlog": "arva_hil.links.tlog:TlogLink",
        "stdout": "arva_hil.links.stdout:StdoutLink",
        "can": "arva_hil.links.dronecan:DroneCanLink",
    },
    ("open", "read", "write", "close", "reopened"),
)
OBSERVERS: Final = Registry("observer", "arva_hil.observers", {}, ("observe",), references=True)  # for --observer
COMMANDS: Final = Registry("command", "arva_hil.commands", {}, ("options", "main"))  # of other packages
EXPORTS: Final = Registry(  # a function (recording, binary file) -> None
    "export format",
    "arva_hil.exports",
    {
        "kml": "arva_hil.records.exports.xml:write_kml",
        "gpx": "arva_hil.records.exports.xml:write_gpx",
        "geojson": "arva_hil.records.exports.geojson:write",
        "csv": "arva_hil.records.exports.table:write",
        "mcap": "arva_hil.records.exports.mcap:write",
    },
    ("__call__",),
)
STRATEGIES: Final = Registry(
    "strategy",
    "arva_hil.strategies",
    {
        "flux": "arva_hil.search.strategies.flux:Flux",
        "extremum": "arva_hil.search.strategies.extremum:Extremum",
        "estimate": "arva_hil.search.strategies.estimate:Estimate",
    },
    ("observe or hear", "velocity"),
    references=True,
    made_with=(1.0,),  # m/s
    attributes=("found",),
)
