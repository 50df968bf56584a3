"""Many small cases as one test: what a test costs beside what it does is a millisecond or two, in each worker."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import Any

import pytest

_FAILURES = (Exception, pytest.fail.Exception)


def every(names: str, cases: Iterable[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """As `pytest.mark.parametrize`, for cases that take no time each and share what the fixtures give.

    All are tried; each that fails is named in the error.
    """
    arguments = [name.strip() for name in names.split(",")]
    tried = [(_name(case), dict(zip(arguments, _values(case, arguments), strict=True))) for case in cases]
    assert tried

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def together(**others: Any) -> None:
            failures: list[BaseException] = []
            for name, values in tried:
                try:
                    test(**values, **others)
                except _FAILURES as error:
                    error.add_note(f"case: {name}")
                    failures.append(error)
            if failures:
                raise BaseExceptionGroup(f"{len(failures)} of {len(tried)} cases of {test.__name__}", failures)

        signature = inspect.signature(test)
        kept = [parameter for name, parameter in signature.parameters.items() if name not in arguments]
        del together.__wrapped__  # type: ignore[attr-defined]
        together.__signature__ = signature.replace(parameters=kept)  # type: ignore[attr-defined]
        return together

    return decorate


def _values(case: Any, arguments: list[str]) -> Iterable[Any]:
    if hasattr(case, "marks"):
        return tuple(case.values)
    return (case,) if len(arguments) == 1 else tuple(case)


def _name(case: Any) -> str:
    return str(getattr(case, "id", None) or case)[:200]
