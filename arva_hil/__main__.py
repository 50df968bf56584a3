"""`arva-hil`, which is `python -m arva_hil` too. It imports next to nothing before Ctrl-C is answered."""

from __future__ import annotations

import sys

INTERRUPTED = 130  # as in cli/outcome.py, which is not imported yet


def main() -> int:
    """Run the command that the command line names; gives back the exit code. Ctrl-C is no traceback at any time."""
    try:
        from arva_hil.cli.main import main as run

        code = run()
    except KeyboardInterrupt:
        code = INTERRUPTED
    _die_quietly()
    return code


def _die_quietly() -> None:
    """A signal that comes while Python itself ends makes no traceback: from here on it ends the process at once."""
    import signal

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    sys.exit(main())
