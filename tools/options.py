"""What the programs of this folder share: their options, and the memory that they take."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any


def parser(doc: str | None, **options: tuple[Any, str]) -> argparse.ArgumentParser:
    """Return a parser. `options`: the default of each option, or its type if there is none, and its help.

    An option whose default is False is a flag.
    """
    made = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, (default, text) in options.items():
        flag = "--" + name.replace("_", "-")
        if default is False:
            made.add_argument(flag, action="store_true", help=text)
        elif isinstance(default, type):
            made.add_argument(flag, type=default, help=text)
        else:
            made.add_argument(flag, type=type(default), default=default, help=f"{text}; default {default}".strip("; "))
    return made


def memory_mb() -> float:
    """Return the resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
