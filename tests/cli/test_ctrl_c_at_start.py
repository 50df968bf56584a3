"""Ctrl-C, or another signal, before the program has got anywhere: exit code 130 and no traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

HOOK = '''
import os, _signal, sys, importlib.abc

class Interrupts(importlib.abc.MetaPathFinder):
    """A signal comes while a certain module is imported."""

    def find_spec(self, name, path, target=None):
        if name == os.environ["INTERRUPT_AT"]:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), getattr(_signal, os.environ["INTERRUPT_BY"]))

sys.meta_path.insert(0, Interrupts())
'''


WAYS = {
    "python -m arva_hil": ["-m", "arva_hil"],
    "arva-hil": ["-c", "import sys; from arva_hil.__main__ import main; sys.exit(main())"],
}
MODULES = {
    "signal": "SIGINT",
    "argparse": "SIGTERM",
    "arva_hil.cli.main": "SIGINT",
    "arva_hil.search.mission.mission": "SIGHUP",
    "arva_hil.cli.arguments.searches": "SIGTERM",
    "numpy": "SIGINT",
}


@pytest.mark.parametrize("how", WAYS)
@pytest.mark.parametrize("module", MODULES)
def test_a_signal_while_a_module_is_imported_ends_it_quietly(tmp_path: Path, module: str, how: str) -> None:
    (tmp_path / "sitecustomize.py").write_text(HOOK)
    command = [sys.executable, *WAYS[how], "demo", "--speed", "max"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "INTERRUPT_AT": module, "INTERRUPT_BY": MODULES[module]}
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (130, "")
    assert "Traceback" not in done.stderr
