"""Figures that are not drawn, for tests of what else a command does: to draw one takes as long as to fly for 20 s."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def undrawn() -> Iterator[None]:
    """Figures are saved as files without a picture."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, file, **options: file.write(b"<svg></svg>"))
        yield
