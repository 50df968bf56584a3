"""An observer: counts events by their names, and writes the counts into a file."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from arva_hil import Event


class Count:
    """The number of events of each name."""

    @dataclass(frozen=True)
    class Options:
        """Options on the command line: `--observer count,out=FILE`."""

        out: Path
        least: int = 1

    def __init__(self, options: Options) -> None:
        self._options = options
        self._counts: Counter[str] = Counter()

    def observe(self, event: Event) -> None:
        self._counts[type(event).__name__] += 1

    def close(self) -> None:
        counts = {name: count for name, count in self._counts.items() if count >= self._options.least}
        self._options.out.write_text(json.dumps(counts))
