"""`arva-hil`, also `python -m arva_hil`. It handles Ctrl-C before it imports anything slow."""

import gc
import os
import sys

INTERRUPTED = 130  # as in cli/outcome.py, which is not imported yet


def main() -> int:
    """Run the command that the command line names; return the exit code.

    While a command is imported, and after its end, a signal ends the process at once. An exception within an
    import may be replaced by another one.
    """
    gc.disable()  # imports create many objects, none of them garbage; `cli.main` enables it before a command starts
    try:
        import signal  # takes a few milliseconds

        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number and signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
                signal.signal(number, lambda *_: os._exit(INTERRUPTED))
    except KeyboardInterrupt:
        os._exit(INTERRUPTED)
    from arva_hil.cli.main import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())
