"""Run a program of this folder: `python -m tools GROUP [PROGRAM] [OPTIONS]`; without a group list the programs."""

from __future__ import annotations

import ast
import importlib.util
import os
import sys
from pathlib import Path

PROGRAMS = {
    "bench": "tools.bench.speed",
    "bench house": "tools.bench.house",
    "bench finds": "tools.bench.finds",
    "bench worlds": "tools.bench.worlds",
    "figures paper": "tools.figures.paper",
    "figures receivers": "tools.figures.receivers",
    "figures pulses": "tools.figures.pulses",
    "figures demo": "tools.figures.demo",
    "figures fits": "tools.figures.fits",
    "fuzz python": "tools.fuzz.python",
    "fuzz c": "tools.fuzz.c",
    "fuzz codecs": "tools.fuzz.codecs",
    "fuzz mutants": "tools.fuzz.mutants",
    "fuzz autopilot": "tools.fuzz.autopilot",
    "fuzz sensors": "tools.fuzz.sensors",
    "sitl fly": "tools.sitl.fly",
    "sitl lua": "tools.sitl.scripts",
    "soak run": "tools.soak.run",
    "soak can": "tools.soak.run",
    "soak kills": "tools.soak.kills",
    "vectors": "tools.vectors.make",
    "reference": "tools.write_reference",
    "release": "tools.check_release",
}


def main() -> int | None:
    words = sys.argv[1:]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of two threads on a busy core, one waits and burns CPU
    for count in (2, 1):
        name = " ".join(words[:count])
        if module := PROGRAMS.get(name):
            sys.argv[:] = [f"python -m tools {name}", *words[count:]]
            code: int | None = importlib.import_module(module).main()
            return code
    for name, module in PROGRAMS.items():
        print(f"{name:18} {_about(module)}")
    return 2 if words else 0


def _about(module: str) -> str:
    """Return the first line of a program's docstring, without running it."""
    spec = importlib.util.find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    doc = ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))) or ""
    return doc.partition("\n")[0]


if __name__ == "__main__":
    sys.exit(main())
