"""The C code, compiled once for all workers of a run of the tests."""

import pytest

from tests.once import once
from tools.c_codec import Codec
from tools.c_messages import CMessages


@pytest.fixture(scope="session")
def codec(tmp_path_factory):
    return Codec(once(tmp_path_factory, "c-frames", Codec))


@pytest.fixture(scope="session")
def code(tmp_path_factory):
    return CMessages(once(tmp_path_factory, "c-messages", CMessages))
