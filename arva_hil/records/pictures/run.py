"""The pictures of a run: each by itself, or all on one sheet; that of a search."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from arva_hil.records.pictures.flight_map import draw_map
from arva_hil.records.pictures.over_time import draw_distance, draw_lateness, draw_streams, draw_timeline
from arva_hil.records.pictures.style import SCREEN, Format, Print, figure, move_legend, plain, saved, styled
from arva_hil.records.reading import Recording, streams

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Draw = Callable[["Axes"], None]

NAMES: Final = ("map", "distance", "timeline", "lateness", "streams")
_SIZES: Final = {"map": (6.2, 5.6), "distance": (6.2, 3.8), "timeline": (6.2, 2.6)}
_USUAL: Final = (6.2, 3.2)


def pictures(
    recording: Recording, format: Format, *, transparent: bool = False, form: Print = SCREEN
) -> Iterator[tuple[str, str, bytes]]:
    """(receiver, picture, file) of each receiver of a record; the log of a search alone has one without a name.

    Raises ModuleNotFoundError without matplotlib, RecordingError for a log that cannot be read.
    """
    with styled(form.style):
        for receiver, draws in _draws(recording):
            for name, draw in draws.items():
                made = form.figure(*_SIZES.get(name, _USUAL))
                axes = made.add_subplot()
                draw(axes)
                move_legend(made, axes)
                if form.paper:
                    axes.set_title("")
                yield receiver, name, saved(made, format, transparent=transparent)


def sheets(recording: Recording, format: Format) -> Iterator[tuple[str, bytes]]:
    """(receiver, file) of each receiver: all its pictures on one sheet. Raises as `pictures` does."""
    with styled():
        for receiver, draws in _draws(recording):
            made = figure(13.0, 9.5)
            last = ["lateness", "streams"] if "streams" in draws else ["map", "timeline"]
            mosaic: Any = [["map", "distance"], ["map", "timeline"], last]
            places = made.subplot_mosaic(mosaic, height_ratios=[1.0, 0.62, 0.75])
            for name, draw in draws.items():
                draw(places[name])
            made.suptitle(plain(" · ".join(filter(None, [recording.title, receiver]))), fontsize=12)
            yield receiver, saved(made, format)


def of_search(recording: Recording) -> bytes:
    """Return a PNG of the flight from above, beside d over time. Raises ModuleNotFoundError without matplotlib."""
    receiver = next(iter(recording.receivers), None)
    with styled():
        made = figure(10.0, 4.8)
        above, time = made.subplots(1, 2)
        draw_map(above, recording, receiver)
        draw_distance(time, recording, receiver)
        return saved(made, "png")


def _draws(recording: Recording) -> Iterator[tuple[str, dict[str, Draw]]]:
    """Yield the name of each receiver, and the pictures for which the record has data."""
    for receiver in recording.receivers or (None,):
        draws: dict[str, Draw] = {
            "map": partial(draw_map, recording=recording, receiver=receiver),
            "distance": partial(draw_distance, recording=recording, receiver=receiver),
            "timeline": partial(draw_timeline, recording=recording, receiver=receiver),
        }
        if receiver is not None:
            draws["lateness"] = partial(draw_lateness, receiver=receiver)
            draws["streams"] = partial(draw_streams, streams=streams(recording, receiver.vehicle))
        yield receiver.name if receiver is not None else "", draws
