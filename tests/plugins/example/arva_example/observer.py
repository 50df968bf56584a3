"""An observer: counts events by their names, and writes the counts into the file that ARVA_EXAMPLE_COUNTS names."""

from __future__ import annotations

import json
import os
from collections import Counter
from pathlib import Path

from arva_hil import Event


class Count:
    """Remembers how many there were of each."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def observe(self, event: Event) -> None:
        self._counts[type(event).__name__] += 1

    def close(self) -> None:
        Path(os.environ["ARVA_EXAMPLE_COUNTS"]).write_text(json.dumps(self._counts))
