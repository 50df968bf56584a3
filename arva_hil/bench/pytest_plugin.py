"""The pytest plugin: fixtures that put an emulated receiver before the code under test.

pytest imports this module in each project where arva-hil is installed. Therefore it imports nothing slow at its top.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Protocol

import pytest

if TYPE_CHECKING:
    import os
    from typing import Literal

    from arva_hil.bench.bench import Bench
    from arva_hil.config import Scenario

    class BenchFactory(Protocol):
        """Makes benches; the fixture closes them after the test."""

        def __call__(
            self,
            scenario: Scenario | str | os.PathLike[str] | None = None,
            *,
            port: str | None = None,
            clock: Literal["virtual", "real"] = "virtual",
            autopilot: str | None = None,
        ) -> Bench: ...


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the fixtures."""
    group = parser.getgroup("arva", "emulated avalanche receiver (arva-hil)")
    group.addoption("--arva-scenario", metavar="FILE", help="scenario of arva_bench; default: the built-in one")
    group.addoption("--arva-port", metavar="URL", help="real port for the frames of arva_bench, e.g. /dev/ttyUSB0")
    parser.addini("arva_scenario", "scenario of arva_bench, from the folder of this file", type="paths", default=[])


@pytest.fixture
def arva_bench_factory(request: pytest.FixtureRequest) -> Iterator[BenchFactory]:
    """Function that makes benches: `arva_bench_factory(scenario, port=…, clock=…, autopilot=…)`.

    A scenario given here is stronger than `--arva-scenario`, which is stronger than the ini key `arva_scenario`.
    """
    from contextlib import ExitStack

    from arva_hil.bench.bench import Bench
    from arva_hil.errors import ArvaError

    config = request.config
    usual = config.getoption("--arva-scenario") or next(iter(config.getini("arva_scenario")), None)
    usual_port = config.getoption("--arva-port") or "pty"
    with ExitStack() as stack:

        def make(scenario: Any = None, *, port: str | None = None, **options: Any) -> Bench:
            try:
                return stack.enter_context(Bench(scenario or usual, port=port or usual_port, **options))
            except ArvaError as error:
                wrong = error
            pytest.fail("\n".join(map(str, getattr(wrong, "problems", ()) or [wrong])), pytrace=False)

        yield make


@pytest.fixture
def arva_bench(arva_bench_factory: Callable[[], Bench]) -> Bench:
    """Fresh bench with a virtual clock: a `Bench`."""
    return arva_bench_factory()
