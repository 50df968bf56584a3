"""Checks of arguments that are arrays. Lists of numbers are accepted."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def require(*checks: tuple[bool, str]) -> None:
    """Raise ValueError with the sentence of the first check that does not hold."""
    for holds, sentence in checks:
        if not holds:
            raise ValueError(sentence)


def floats(name: str, value: ArrayLike, *shape: int | None) -> Array:
    """Return `value` as an array of floats whose last dimensions are `shape`; None in it means any length.

    Raises ValueError with the argument's name, what was found, and what was expected.
    """
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        short = text if len(text := repr(value)) <= 60 else text[:59] + "…"
        raise ValueError(f"{name}: {short}, expected numbers{_said(shape)}") from None
    last = array.shape[max(0, array.ndim - len(shape)) :]
    if shape and (len(last) != len(shape) or any(n not in (h, None) for h, n in zip(last, shape, strict=True))):
        raise ValueError(f"{name}: the shape {array.shape}, expected numbers{_said(shape)}")
    return array


def vector(name: str, value: ArrayLike, *shape: int) -> Array:
    """Return `value` as an array of floats of exactly this shape. Raises ValueError as `floats`."""
    array = value if isinstance(value, np.ndarray) and value.dtype == np.float64 else floats(name, value)
    if array.shape != shape:
        raise ValueError(f"{name}: the shape {array.shape}, expected {shape}")
    return array


def _said(shape: tuple[int | None, ...]) -> str:
    sizes = ", ".join("M" if n is None else str(n) for n in shape)
    return f" of the shape (..., {sizes})" if shape else ""
