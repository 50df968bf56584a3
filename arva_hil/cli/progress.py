"""How far long work is, and how long it still takes: a bar on a terminal of any width."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tqdm import tqdm

_FORM: Final = "{percentage:3.0f} % |{bar}| {n_fmt} of {total_fmt}{unit}, {remaining} left"


def bar(total: int, unit: str, *, done: int = 0, scaled: bool = False, shown: bool = True) -> tqdm[Any]:
    """A bar on stderr, gone when it is closed. `scaled`: numbers as 12.3k, for bytes."""
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
    """How long `more` will take when `done` took `after_s`, e.g. "about 0:17:25 left"; "" when that cannot be said."""
    if not done or not more:
        return ""
    minutes, seconds = divmod(round(more * after_s / done), 60)
    hours, minutes = divmod(minutes, 60)
    return f"about {hours}:{minutes:02}:{seconds:02} left"
