"""Run a program of this folder: `python -m tools GROUP [PROGRAM] [OPTIONS]`; without a group list the programs."""

from __future__ import annotations

import ast
import importlib.util
import runpy
import sys
from pathlib import Path

PROGRAMS = {
    "bench": "tools.bench.__main__",
    "bench house": "tools.house",
    "bench finds": "tools.measure_false_finds",
    "bench worlds": "tools.measure_worlds",
    "bench page": "tools.page_moments",
    "figures paper": "tools.paper_figures",
    "figures receivers": "tools.receiver_figures",
    "figures pulses": "tools.receiver_pictures",
    "figures pages": "tools.page_pictures",
    "figures demo": "tools.demo_picture",
    "figures film": "tools.demo_film",
    "real fits": "tools.real.round_trips",
    "fuzz python": "tools.fuzz.python",
    "fuzz c": "tools.fuzz.c",
    "fuzz frames": "tools.compare_decoders",
    "fuzz messages": "tools.compare_messages",
    "fuzz mutants": "tools.mutants",
    "fuzz autopilot": "tools.hostile",
    "fuzz sensors": "tools.lying_sensors",
    "sitl fly": "tools.fly_simulators",
    "sitl lua": "tools.fly_lua",
    "sitl pilot": "tools.pilot_authority",
    "soak run": "tools.long_run",
    "soak can": "tools.can_tunnel",
    "soak kills": "tools.random_kills",
    "vectors": "tools.make_vectors",
    "reference": "tools.write_reference",
    "release": "tools.check_release",
}


def main() -> None:
    words = sys.argv[1:]
    for count in (2, 1):
        if module := PROGRAMS.get(" ".join(words[:count])):
            sys.argv[:] = [f"tools {words[0]}", *words[count:]]
            runpy.run_module(module, run_name="__main__", alter_sys=True)
            return
    for name, module in PROGRAMS.items():
        print(f"{name:18} {_about(module)}")
    sys.exit(2 if words else 0)


def _about(module: str) -> str:
    """Return the first line of a program's docstring, without running it."""
    spec = importlib.util.find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    doc = ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))) or ""
    return doc.partition("\n")[0]


if __name__ == "__main__":
    main()
