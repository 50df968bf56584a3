"""A new pseudo-terminal: the other program opens `path` as if it were a serial port."""

from __future__ import annotations

import contextlib
import os

from arva_hil.links.base import LinkError
from arva_hil.links.ports import far_program
from arva_hil.links.stream import FdLink


class PtyLink(FdLink):
    """The master's side of a new pseudo-terminal, raw from the first byte on.

    `path` is the slave's device; `symlink`, when given, is a file name that leads there until `close`. One
    descriptor of the slave is held, so the other program may come, go and come again: it is never "lost".
    Raises LinkError where there are no pseudo-terminals and when the symlink's name is taken.
    """

    def __init__(self, symlink: str = "") -> None:
        name = f"pty:{symlink}" if symlink else "pty"
        try:
            import tty

            master, self._slave = os.openpty()
        except ImportError:
            raise LinkError(name, "this system has no pseudo-terminals", "use tcpin:127.0.0.1:5760") from None
        except OSError as error:
            raise LinkError(name, f"no pseudo-terminal: {error.strerror}") from error
        self.path = os.ttyname(self._slave)
        self.symlink = symlink
        super().__init__(f"{name} ({self.path})", master)
        tty.setraw(self._slave)
        try:
            self._make_symlink()
        except BaseException:
            self.symlink = ""
            self.close()
            raise

    def _make_symlink(self) -> None:
        """Make the symlink; replace one that leads nowhere, or to this very device: a killed run left it."""
        link = self.symlink
        if not link:
            return
        try:
            if os.path.islink(link):
                if os.path.exists(link) and os.path.realpath(link) != self.path:
                    held = f"is a symlink to {os.path.realpath(link)}, which exists"
                    if who := far_program(link):
                        held += f", held by {who}"
                    raise LinkError(f"pty:{link}", held, f"remove it (rm {link}) or take another name")
                os.unlink(link)
            os.symlink(self.path, link)
        except FileExistsError:
            raise LinkError(f"pty:{link}", "exists and is no symlink", "take another name") from None
        except OSError as error:
            raise LinkError(f"pty:{link}", f"the symlink cannot be made: {error.strerror}") from error

    def _shut(self) -> None:
        with contextlib.suppress(OSError):
            if self.symlink and os.readlink(self.symlink) == self.path:
                os.unlink(self.symlink)
        os.close(self._fd)
        os.close(self._slave)
