"""A link that may be lost and come back, and what there is to tell of it."""

from __future__ import annotations

from typing import Final

from arva_hil.links import Link
from arva_hil.notice import Notice

_WORTH_SAYING_S: Final = 0.05  # shorter than this, it was no absence


class Watched:
    """A link, and what was last seen of it. `news` is to be asked for after `lost_again` and `renewed_again`."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self._lost_at = 0.0
        self._note()

    @property
    def lost_again(self) -> bool:
        return self.link.losses > self._losses

    @property
    def renewed_again(self) -> bool:
        return self.link.renewals > self._renewals

    def news(self, now: float) -> list[Notice]:
        """A line when it is lost, one when it is there (again), and one when there is another reason why it is not.

        And one, once, when others than the far end speak.
        """
        link, said = self.link, []
        if self.lost_again:
            self._lost_at = now
            said.append(Notice("warning", link.why))
        elif link.away and link.why != self._why:
            said.append(Notice("warning", link.why))
        if link.returns > self._returns:
            away = now - self._lost_at
            after = f" after {away:.1f} s" if away > _WORTH_SAYING_S else ""
            said.append(Notice("info", f"{link.name}: back{after}"))
        elif self._away and not link.away:
            said.append(Notice("info", f"{link.name}: is there"))
        if link.strangers and not self._strangers:
            said.append(
                Notice("info", f"{link.name}: what others than its peer send is ignored, as from {link.stranger}")
            )
        self._note()
        return said

    def _note(self) -> None:
        """Whatever happened up to now is known."""
        link = self.link
        self._losses, self._renewals, self._returns, self._why = link.losses, link.renewals, link.returns, link.why
        self._strangers, self._away = link.strangers, link.away
