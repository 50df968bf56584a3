"""The C code, compiled once for all workers of a run of the tests; and the tools that try it."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.once import once
from tools.vectors.c_codec import CMessages, Codec


@pytest.fixture(scope="session")
def codec(tmp_path_factory):
    return Codec(once(tmp_path_factory, "c-frames", Codec))


@pytest.fixture(scope="session")
def code(tmp_path_factory):
    return CMessages(once(tmp_path_factory, "c-messages", CMessages))


@pytest.fixture
def run_tool():
    """Runs a tool by its module's name, which has to end well: what it prints."""

    def run(*words):
        done = subprocess.run(
            [sys.executable, "-m", *words], capture_output=True, text=True, cwd=Path(__file__).parents[2]
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run
