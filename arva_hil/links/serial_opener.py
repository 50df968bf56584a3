"""Opens a lost serial port again, also if its number has changed, and finds out why that fails."""

from __future__ import annotations

import errno
import math
import os
from typing import Final

from arva_hil.links import Address, open_link
from arva_hil.links.base import Link, LinkError
from arva_hil.links.processes import far_program
from arva_hil.links.serial_ports import stable_name
from arva_hil.runtime.clock import Clock

_STUBBORN_S: Final = 1.0  # after a port is plugged in, its permissions are set late, and other programs probe it
_BARRED: Final = frozenset((errno.EBUSY, errno.EAGAIN, errno.EACCES, errno.EPERM))


class Barred(LinkError):
    """A link that exists, but can only be opened after a person has done something."""


class SerialOpener:
    """Opens a serial port again by its stable name. If it stays busy or forbidden, raises Barred once with the cause.

    A pseudo-terminal without a symlink must belong to the same program as before, because the system reuses numbers.
    """

    def __init__(self, address: Address, clock: Clock) -> None:
        self.path = stable_name(address.path)
        self._address = address._replace(path=self.path)
        self._clock = clock
        known = os.path.exists(self.path) and not os.path.islink(self.path)
        self._program = far_program(self.path) if known else None
        self._bar = ""  # the error of all tries so far
        self._since = 0.0  # when it began; infinite after it was reported

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
        if self._program and not os.path.exists(self.path):  # saves the search for its program
            raise LinkError(self.path, "no such port")
        if self._program is not None and (other := far_program(self.path)) != self._program:
            whose = f": {other[:60]}" if other else ""
            hint = "name a symlink, which finds the pseudo-terminal if its number changes"
            raise Barred(self.path, f"now belongs to another program{whose}", hint)
        return open_link(self._address, clock=self._clock, brief=brief)

    def _stubborn(self, bar: str) -> bool:
        """Whether the error has lasted for long, and was not reported yet."""
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
