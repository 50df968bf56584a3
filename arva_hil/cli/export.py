"""`arva-hil export`: writes a record in the format of another program."""

from __future__ import annotations

import argparse
from pathlib import Path

from arva_hil.cli.outcome import UsageError
from arva_hil.cli.recorded import loaded, needing, output
from arva_hil.registry import EXPORTS


def main(options: argparse.Namespace) -> None:
    if not options.out:
        raise UsageError("--out is missing: name the file to write, e.g. --out flight.kml, or - for stdout")
    name, suffix = options.export_format, Path(options.out).suffix.lower().removeprefix(".")
    if name is None:
        name = _by_suffix(options.out)
    elif suffix != name and suffix in EXPORTS:
        raise UsageError(f"--format {name}: --out {options.out} says {suffix}: leave one of them out")
    with needing(name, f"--format {name}"):
        write = EXPORTS[name]
    recording = loaded(options.run)
    with needing(name, f"--format {name}"), output(options.out, recording) as out:
        write(recording, out)


def _by_suffix(name: str) -> str:
    """Return the format that a file's name ends with. Raises UsageError."""
    suffix = Path(name).suffix.lower().removeprefix(".")
    if suffix not in EXPORTS:
        raise UsageError(f"--format is missing: choose {', '.join(EXPORTS)}; the name {name} does not say which")
    return suffix
