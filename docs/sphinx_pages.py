"""What Sphinx needs for these pages: documents that lie elsewhere, the commands' options, equations as MathML."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

import arva_hil
from arva_hil import events
from arva_hil.autopilot.commanding.authority import HOLDERS
from arva_hil.autopilot.commanding.commander import PHASES
from arva_hil.cli.arguments import arguments_of
from arva_hil.cli.main import COMMANDS
from arva_hil.cli.options import CommandParser
from arva_hil.config.tables import Table
from arva_hil.events import searches, vehicles
from arva_hil.events.event_json import event_name
from arva_hil.search.flight.preflight import CONSENTS
from tools import write_reference

HERE: Final = Path(__file__).parent
ROOT: Final = HERE.parent
ELSEWHERE: Final = {  # a page here → the document that is its text
    "reference/protocol": "firmware_proto/PROTOCOL.md",
    "reference/c": "firmware_proto/c/README.md",
    "reference/ardupilot-driver": "firmware_proto/ardupilot/arva_receiver.md",
    "reference/ardupilot-search": "firmware_proto/ardupilot/arva_search.md",
    "reference/ardupilot-victim": "firmware_proto/ardupilot/arva_victim.md",
    "reference/px4-driver": "firmware_proto/px4/README.md",
    "contributing": "CONTRIBUTING.md",
    "changelog": "CHANGELOG.md",
}
API: Final = {  # groups of the public names, in the order of the page
    "Run": "run_live replay load_scenario Scenario Recording ArvaError ScenarioError RecordError",
    "Engine": "Emulator Output VehicleSetup ReceiverSetup one_vehicle Session SimulatedVehicle Event FrameMade",
    "Field and receivers": "dipole_field Transmitters LocalFrame readings Readings PaperReceiver Antennas Pose Look "
    "Reading ChannelReading Zone",
    "Search strategies": "Strategy Observation Found Position Velocity STILL towards",
    "Tests": "Bench BenchTruth BenchError",
    "Plug-ins": "ReceiverModel ReceiverSettings Answer Link Address Opening AddressError LinkError LinkEnded FaultKind "
    "Number Whole Observer KindError UnknownKindError",
}
MEMBERS: Final = {  # of classes with more for this package alone
    "CommandParser": "option, usual, group",
    "LocalFrame": "ned, lla",
    "Session": "feed, poll, interrupt, resume",
    "Transmitters": "field_at, ranges",
}
WITHOUT: Final = ("PaperReceiver", "Scenario", "Fault", "Transmitter", "Number", "Whole", "FaultKind")  # members
PAGES: Final = {"search": "[Search](../howto/search.md) and its [safety](../explanation/safety.md)"}
EVENTS: Final = {"Run": events, "Vehicle": vehicles, "Search": searches}
_PAGES: Final = {ROOT / text: HERE / f"{page}.md" for page, text in ELSEWHERE.items()}
_ARRAY: Final = re.compile(r"ndarray\[tuple\[Any, \.\.\.\], dtype\[(\w+)\]\]")
_LINK: Final = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^()\s#]+)(#[^()\s]*)?(?=\))")


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("source-read", read)
    app.connect("autodoc-process-docstring", literals)
    app.connect("autodoc-process-signature", signature)
    app.connect("autodoc-skip-member", leave_out)
    app.add_html_math_renderer("mathml", (_mathml("inline"), None), (_mathml("block"), None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def read(app: Sphinx, page: str, source: list[str]) -> None:
    """The text of a page, with its links as they are seen from there."""
    text, at = source[0], HERE / page
    if page in ELSEWHERE:
        at = ROOT / ELSEWHERE[page]
        text = at.read_text(encoding="utf-8")
        app.env.note_dependency(str(at))
    if page == "reference/python":
        text += "\n" + "\n\n".join(api_sections())
    if page == "scenario":
        text += "\n" + write_reference.page()
    if page == "reference/commands":
        text += "\n" + "\n\n".join(command_sections())
    if page == "explanation/safety":
        text += "\n" + "\n\n".join(state_tables())
    if page == "reference/events":
        text += "\n" + "\n\n".join(event_tables())

    def link(match: re.Match[str]) -> str:
        target = Path(os.path.normpath(at.parent / match[1]))
        target = target / "README.md" if target.is_dir() else target
        path = os.path.relpath(_PAGES.get(target, target), (HERE / page).parent)
        no_page = target.suffix == ".md" and target not in _PAGES and HERE not in target.parents
        return ("path:" if no_page else "") + path + (match[2] or "")

    source[0] = _LINK.sub(link, re.sub("(?m)^```(handheld|nmea|commands)$", "```text", text))


def literals(app: Sphinx, what: str, name: str, item: object, options: object, lines: list[str]) -> None:
    """`Code` of a docstring, which reStructuredText marks by two backticks. A value has no docstring of its own."""
    if what == "data":
        lines.clear()
    lines[:] = [re.sub(r"(?<![`:\w])`([^`]+)`(?!`)", r"``\1``", line) for line in lines]


def signature(
    app: Sphinx, what: str, name: str, item: object, options: object, arguments: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Only the names of keys of files, whose types are on the scenario's page, and of fields that follow."""
    if arguments and inspect.isclass(item) and (issubclass(item, Table) or described_fields(item)):
        arguments = "(" + ", ".join(inspect.signature(item).parameters) + ")"
    shorter = (text and _ARRAY.sub(r"NDArray[\1]", text) for text in (arguments, returns))
    return next(shorter), next(shorter)


def described_fields(item: type) -> set[str]:
    """Return the names of the fields of a class that have a docstring of their own."""
    found = ModuleAnalyzer.for_module(item.__module__).find_attr_docs()
    return {name for owner, name in found if owner == item.__qualname__}


def leave_out(app: Sphinx, what: str, name: str, item: object, skip: bool, options: object) -> bool | None:
    """Leave out the fields of a named tuple, which its signature has with their types."""
    return True if (inspect.getdoc(item) or "").startswith("Alias for field number") else None


def state_tables() -> Iterator[str]:
    """Yield a section for each table of states: of a flight, of the authority, and of the permission to arm."""
    tables = {"The phases of a flight": PHASES, "Who has the vehicle": HOLDERS, "The permission to arm": CONSENTS}
    for title, table in tables.items():
        rows = [f"## {title}", "", "| state | meaning | may be followed by |", "|---|---|---|"]
        for state, rule in table.items():
            rows.append(f"| {state.name} | {rule.meaning} | {', '.join(one.name for one in rule.then)} |")
        yield "\n".join(rows)


def api_sections() -> Iterator[str]:
    """Yield a section for each group of public names; names of no group are in the last one."""
    left = list(arva_hil.__all__)
    groups = {title: names.split() for title, names in API.items()}
    grouped = {name for names in groups.values() for name in names}
    groups["Plug-ins"] += [name for name in left if name not in grouped]
    for title, names in groups.items():
        lines = "\n\n".join(_directive(name) for name in names if name in left)
        yield f"## {title}\n\n```{{eval-rst}}\n{lines}\n```"


def _directive(name: str) -> str:
    """Return the directive that documents one public name."""
    item = getattr(arva_hil, name)
    if inspect.isclass(item):
        kind = "autoexception" if issubclass(item, BaseException) else "autoclass"
        members = "" if name in WITHOUT else f"\n   :members: {MEMBERS.get(name, '')}".rstrip()
        return f".. {kind}:: arva_hil.{name}{members}"
    return f".. {'autofunction' if inspect.isfunction(item) else 'autodata'}:: arva_hil.{name}"


def command_sections() -> Iterator[str]:
    """Yield a section for each command: its description, and its options from its parser.

    An option that another command above has too is not repeated.
    """
    first: dict[str, str] = {}  # a row → the command that has it
    flags: dict[str, list[str]] = {}  # a command → the first flags of its own rows
    for name in COMMANDS:
        add_options = arguments_of(name)
        parser = CommandParser(prog=f"arva-hil {name}")
        add_options(parser)
        variables = {variable.removeprefix("ARVA_HIL_").lower() for variable in parser.variables}
        own, shared = [], dict[str, list[str]]()
        for flag, row in _rows(parser):
            if first.setdefault(row, name) == name:
                own.append(row)
                flags.setdefault(name, []).append(flag)
            else:
                shared.setdefault(first[row], []).append(flag)
        table = ["| option | meaning |\n|---|---|\n" + "\n".join(own)] if own else []
        same = [f"As in [{other}](#{other}): {_all_but(theirs, flags[other])}." for other, theirs in shared.items()]
        options = [one for one in parser._actions if one.option_strings and not isinstance(one, argparse._HelpAction)]
        never = [f"`{one.option_strings[0]}`" for one in options if one.dest not in variables]
        note = [f"Not in the environment: {', '.join(never)}."] if variables and never else []
        about = _prose(inspect.getdoc(add_options) or "")
        if name in PAGES:
            about = about.split("\n\n")[0] + f"\n\nRead first: {PAGES[name]}."
        yield "\n\n".join([f"## {name}", about, *table, *same, *note])


def _all_but(flags: list[str], of: list[str]) -> str:
    """Return flags in words; those of most of another command's by the rest of them."""
    left = [flag for flag in of if flag not in flags]
    listed = ", ".join(f"`{flag}`" for flag in (left if 2 * len(left) < len(flags) else flags))
    return f"all options except {listed}" if left and 2 * len(left) < len(flags) else listed if left else "all options"


def event_tables() -> Iterator[str]:
    """Yield a table of events for each module of `arva_hil.events`: the name in JSON, the fields, the meaning."""
    for title, module in EVENTS.items():
        kinds = [kind for kind in vars(module).values() if inspect.isclass(kind) and kind.__module__ == module.__name__]
        rows = "\n".join(
            _event_row(kind) for kind in kinds if issubclass(kind, events.Event) and not kind.__subclasses__()
        )
        yield f"### {title}\n\n| event | fields | meaning |\n|---|---|---|\n{rows}"


def _event_row(kind: type[events.Event]) -> str:
    """Return the row of one event, without the fields that the text above the tables names."""
    own = [field.name for field in dataclasses.fields(kind) if field.name not in ("time_s", "vehicle", "receiver")]
    about = " ".join((inspect.getdoc(kind) or "").split())
    return f"| `{event_name(kind)}` | {', '.join(f'`{name}`' for name in own)} | {_cell(about)} |"


def _rows(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """Yield each option's first flag and its row."""
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction):
            continue
        value = action.metavar or (action.choices and "{" + ",".join(map(str, action.choices)) + "}") or ""
        value = "" if action.nargs == 0 else str(value)
        names = [f"{flag} {value}".strip() for flag in action.option_strings] or [value or action.dest]
        help_text = (action.help or "") % {**vars(action), "prog": parser.prog}
        yield names[0].split()[0], f"| {', '.join(f'`{_cell(n)}`' for n in names)} | {_cell(_escaped(help_text))} |"


def _prose(text: str) -> str:
    """A parser's description, whose lines end where sentences of their own begin."""
    return "\n".join(_escaped(line) for line in text.strip().splitlines())


def _escaped(text: str) -> str:
    return re.sub(r"([*_<>\[\]#$])", r"\\\1", text)


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


def _mathml(display: str) -> Callable[[Any, nodes.Element], None]:
    def visit(translator: Any, node: nodes.Element) -> None:
        formula = convert(node.astext(), display=display)
        translator.body.append(formula if display == "inline" else f'<div class="math">{formula}</div>')
        raise nodes.SkipNode

    return visit
