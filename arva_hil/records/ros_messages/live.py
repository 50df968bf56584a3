"""The messages of a running program: of its run, its search, or both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from arva_hil.config import Scenario
from arva_hil.events import Event
from arva_hil.events.searches import FromSearch, SearchEvent
from arva_hil.records.ros_messages.readings import RunMessages
from arva_hil.records.ros_messages.searches import TOPICS, SearchMessages
from arva_hil.records.ros_messages.types import Message, Publication


class LiveMessages:
    """Makes the messages of all events. `scenario`: of the run; None for a search alone.

    `epoch_us`: microseconds since 1970 at the loop's time 0. `searches`: whether there is a search.
    `receivers`: (vehicle, receiver); default: the scenario's.
    """

    def __init__(
        self,
        scenario: Scenario | None,
        epoch_us: int,
        *,
        searches: bool,
        receivers: Sequence[tuple[str, str]] | None = None,
    ) -> None:
        self._searches = searches
        self._run = RunMessages(scenario, epoch_us, receivers) if scenario or receivers else None
        self._search = SearchMessages(epoch_us)

    @property
    def topics(self) -> Mapping[str, type[Message]]:
        """All possible topics, with their message types."""
        return {**(self._run.topics if self._run else {}), **(TOPICS if self._searches else {})}

    def of_event(self, event: Event) -> list[Publication]:
        """Return the messages of one event, in their order. Most events have none."""
        if isinstance(event, FromSearch):
            event = event.event
        if isinstance(event, SearchEvent):
            return self._search.of_event(event, self._run.world if self._run else None)
        return self._run.of_event(event) if self._run else []
