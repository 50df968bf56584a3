"""The style of all pictures: colours distinct for colour-blind eyes (M. Okabe, K. Ito, 2008), sizes, files."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from arva_hil.safe_text import one_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Format = Literal["png", "svg", "pdf"]
FORMATS: Final[tuple[Format, ...]] = ("png", "svg", "pdf")

BLUE, RED, GREEN, PINK, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
GREY: Final = "#5b6876"
PALE: Final = "#c9d0d8"
PALETTE: Final = (BLUE, RED, GREEN, PINK, ORANGE, SKY, "#7a5195", GREY)
# of transmitters on white; tests/records/test_pictures.py has the differences for colour-blind eyes
LOOKS: Final = ("#193fb2", "#c68156", "#329990", "#6b2347", "#5b551e", "#9c70ea")
SHAPES: Final = ("o", "s", "^", "D", "v", "p", "h")
MOST_POINTS: Final = 4000  # of a curve; more of them are no better to see

_STYLE: Final = {
    "font.size": 9,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#b9c1ca",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e6ea",
    "legend.fontsize": 8,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "figure.dpi": 110,
    "svg.hashsalt": "arva-hil",  # the same record, the same bytes
    "svg.fonttype": "path",
    "pdf.compression": 6,
}


def look_of(id_: int | None) -> tuple[str, str]:
    """Return the colour and the marker of a transmitter, which are the same in every picture and on the page."""
    return (LOOKS[id_ % len(LOOKS)], SHAPES[id_ % len(SHAPES)]) if id_ is not None and id_ >= 0 else (GREY, "X")


_PAPER: Final = {
    "font.size": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.handlelength": 1.3,
    "legend.handletextpad": 0.5,
    "legend.columnspacing": 1.0,
    "axes.edgecolor": "black",
    "pdf.fonttype": 42,  # TrueType: IEEE refuses Type 3
}


class Print(NamedTuple):
    """The form of pictures for print, by IEEE's rules for authors.

    `width_in`: inches, 3.5 for a column and 7.16 for a page; None: as on a screen. `dpi`: of PNG, None: as on a screen.
    `paper`: without titles, 8 points, fonts embedded as TrueType.
    """

    width_in: float | None = None
    dpi: int | None = None
    paper: bool = False

    @property
    def style(self) -> Mapping[str, Any]:
        """The differences from the usual look."""
        dpi = {"figure.dpi": self.dpi, "savefig.dpi": self.dpi} if self.dpi else {}
        return {**_PAPER, **dpi} if self.paper else dpi

    def figure(self, width: float, height: float) -> Figure:
        """Return an empty figure of these inches, or as wide as asked for with the same shape."""
        wide = self.width_in or width
        return figure(wide, height * wide / width)


SCREEN: Final = Print()
COLUMN_IN: Final = 3.5  # a column of IEEE; a page has 7.16


@contextmanager
def styled(more: Mapping[str, Any] = MappingProxyType({})) -> Iterator[None]:
    """Draw and save figures inside in this style. Raises ModuleNotFoundError without matplotlib.

    `more`: what is different from it.
    """
    import matplotlib

    look: dict[Any, Any] = {**_STYLE, **more}
    with matplotlib.rc_context(look):
        yield


def figure(width: float, height: float) -> Figure:
    """Return an empty figure, sizes in inches, without a window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def move_legend(made: Figure, axes: Axes) -> None:
    """Move the legend below the axes, where it covers nothing."""
    if (inside := axes.get_legend()) is None:
        return
    handles, labels = axes.get_legend_handles_labels()
    inside.remove()
    columns = sum(made.get_size_inches()[0] > width for width in (0, 3, 6))
    made.legend(handles, labels, loc="outside lower center", ncols=columns)


def saved(made: Figure, format: Format, *, transparent: bool = False) -> bytes:
    """Return the figure as a file. The same figure gives the same bytes."""
    out = io.BytesIO()
    dates: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
    made.savefig(out, format=format, metadata=dates[format], transparent=transparent)
    return out.getvalue()


def plain(text: str) -> str:
    """Return a text from outside for a picture: on one line, and without formulas, which matplotlib reads in `$…$`."""
    return one_line(text).replace("$", r"\$")


def some(which: ArrayLike) -> NDArray[np.int64]:
    """Return the numbers of the points that are True, thinned."""
    rows = np.flatnonzero(which)
    return rows[thinned(len(rows))]


def thinned(count: int, most: int = MOST_POINTS) -> NDArray[np.int64]:
    """Return the numbers of at most `most` of so many points, evenly, with the first and the last."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).round().astype(np.int64))
