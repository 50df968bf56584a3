"""The own law of a receiver's display, from a CSV file with the columns `h_na_m` and `d_m`."""

import math
import os
from typing import TYPE_CHECKING, Any, Final

from arva_hil.config.constraints import FLOAT, NamedFile
from arva_hil.config.errors import Problem, ScenarioError, short
from arva_hil.config.tables import Table, key

if TYPE_CHECKING:
    from arva_hil.model.receiver.display import DisplayLaw

_HEAD: Final = "h_na_m,d_m"
_WHAT: Final = f"a CSV file with the columns {_HEAD}"


def _law(value: Any) -> "DisplayLaw | None":
    from arva_hil.model.receiver.display import DisplayLaw  # slow to import

    return value if isinstance(value, DisplayLaw) else None


def _load_law(path: str) -> "DisplayLaw":
    from arva_hil.config.reading import read_text  # slow to import

    return parse_law(read_text(path, _WHAT), path)


class DisplayOptions(Table):
    """The display of a receiver of pulses."""

    table: Any = key(
        NamedFile(_WHAT, _law, _load_law), "measured: d [m] over the field [nA/m] at the antennas that count"
    )


def parse_law(text: str, source: str) -> "DisplayLaw":
    """Return the law in a text; `source` names it. Raises ScenarioError with the first mistake."""
    from arva_hil.model.receiver.display import DisplayLaw  # slow to import

    def fail(line: int, column: int, found: str, expected: str) -> ScenarioError:
        return ScenarioError([Problem(source, line, column, found, expected)])

    head, *rows = text.split("\n")
    if head.strip() != _HEAD:
        raise fail(1, 1, repr(short(head.strip())), f"the header {_HEAD}")
    fields, distances = list[float](), list[float]()
    for line, row in enumerate(rows, 2):
        if not row.strip():
            continue
        cells = row.split(",")
        if len(cells) != 2:
            raise fail(line, 1, f"{len(cells)} values", f"two: {_HEAD}")
        for cell, column in (cells[0], 1), (cells[1], len(cells[0]) + 2):
            if not FLOAT.fullmatch(cell.strip()) or not 0 < float(cell) < math.inf:
                raise fail(line, column, repr(short(cell.strip())), "a number above 0")
        field, d_m = map(float, cells)
        if fields and field <= fields[-1]:
            raise fail(line, 1, f"{field:g} after {fields[-1]:g}", "fields that rise")
        if distances and d_m >= distances[-1]:
            raise fail(line, len(cells[0]) + 2, f"{d_m:g} after {distances[-1]:g}", "d that falls with the field")
        fields.append(field)
        distances.append(d_m)
    if len(fields) < 2:
        raise fail(len(rows) + 1, 1, f"{len(fields)} rows", "two rows or more")
    return DisplayLaw(os.path.abspath(source), tuple(fields), tuple(distances))
