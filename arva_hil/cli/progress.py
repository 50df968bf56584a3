"""Progress of a long task: a bar on a terminal, and the time left."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tqdm import tqdm

_FORM: Final = "{percentage:3.0f} % |{bar}| {n_fmt} of {total_fmt}{unit}, {remaining} left"


def bar(total: int, unit: str, *, done: int = 0, scaled: bool = False, shown: bool = True) -> tqdm[Any]:
    """A bar on stderr. It is erased when it is closed. `scaled`: numbers as 12.3k, for bytes."""
    from tqdm import tqdm  # slow to import

    return tqdm(
        total=total,
        initial=done,
        unit=unit,
        unit_scale=scaled,
        leave=False,
        dynamic_ncols=True,
        bar_format=_FORM,
        disable=not shown,
    )


def time_left(done: int, more: int, after_s: float) -> str:
    """The time that `more` will take if `done` took `after_s`, e.g. "about 0:17:25 left"; "" if it is not known yet."""
    if not done or not more:
        return ""
    minutes, seconds = divmod(round(more * after_s / done), 60)
    hours, minutes = divmod(minutes, 60)
    return f"about {hours}:{minutes:02}:{seconds:02} left"
