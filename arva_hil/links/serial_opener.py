"""How a serial port that was lost is opened again, whatever its number is now; and why it cannot be."""

from __future__ import annotations

import errno
import math
import os
from typing import Final

from arva_hil.links import Address, open_link
from arva_hil.links.base import Link, LinkError
from arva_hil.links.serial_ports import far_program, stable_name
from arva_hil.runtime.clock import Clock

_STUBBORN_S: Final = 1.0  # while a port is plugged in, its permissions come late, and others have a look at it
_BARRED: Final = frozenset((errno.EBUSY, errno.EAGAIN, errno.EACCES, errno.EPERM))


class Barred(LinkError):
    """A link that is there, and that cannot be opened unless a person does something about it."""


class SerialOpener:
    """Opens a serial port again, found by its stable name. One that stays busy or forbidden is looked into, once.

    A pseudo-terminal without a name of its own must be the same program's as before: numbers are given away.
    """

    def __init__(self, address: Address, clock: Clock) -> None:
        self.path = stable_name(address.path)
        self._address = address._replace(path=self.path)
        self._clock = clock
        known = os.path.exists(self.path) and not os.path.islink(self.path)
        self._program = far_program(self.path) if known else None
        self._bar = ""  # what has been in the way of every try
        self._since = 0.0  # when that began; infinite once it was told

    def __call__(self) -> Link:
        try:
            link = self._open(brief=True)
        except LinkError as error:
            if not self._stubborn(error.what if _barred(error) else ""):
                raise LinkError(error.link, error.what) from error
            link = self._look_into()
        self._bar = ""
        return link

    def _look_into(self) -> Link:
        try:
            return self._open(brief=False)
        except LinkError as error:
            if _barred(error):
                raise Barred(error.link, error.what, error.hint) from error
            raise

    def _open(self, *, brief: bool) -> Link:
        if self._program and not os.path.exists(self.path):  # nobody has to be asked whose it is
            raise LinkError(self.path, "no such port")
        if self._program is not None and (other := far_program(self.path)) != self._program:
            whose = f": {other[:60]}" if other else ""
            hint = "a symlink finds a pseudo-terminal whatever its number"
            raise Barred(self.path, f"is another program's now{whose}", hint)
        return open_link(self._address, clock=self._clock, brief=brief)

    def _stubborn(self, bar: str) -> bool:
        """Whether it has been this for long, and was not told."""
        now = self._clock.now()
        if bar != self._bar:
            self._bar, self._since = bar, now
        told = bool(bar) and now - self._since >= _STUBBORN_S
        if told:
            self._since = math.inf
        return told


def _barred(error: LinkError) -> bool:
    cause = error.__cause__
    return isinstance(error, Barred) or getattr(cause, "errno", None) in _BARRED or "PermissionError" in str(cause)
