"""Applies the faults of one run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from arva_hil.config import Fault, Scenario
from arva_hil.emulator.faults.hearing import FaultyReceiver, Switch
from arva_hil.emulator.faults.sending import Outbox, QueuedFrame, Sending
from arva_hil.model.receiver import ReceiverModel
from arva_hil.registry import FAULTS
from firmware_proto import Frame


class Faults:
    """Remembers the faults that are on, those that changed the present frame, and the frames that wait to be sent.

    `receiver`: the `model` with the faults of reception. `present`: the faults; those of the scenario until `change`.
    Call `begin`, then `send`, for each frame. The same scenario gives the same faults in each frame.
    """

    def __init__(self, scenario: Scenario, model: ReceiverModel) -> None:
        self._seed = scenario.seed
        self.receiver = FaultyReceiver(model, scenario)
        self.outbox = Outbox()
        self.met: tuple[str, ...] = ()  # names, in the order of their effects
        self._frames: Counter[str] = Counter()
        self._bytes: Counter[str] = Counter()
        self._on: list[Switch] = []
        self._number = 0
        self.change(scenario.faults)

    def change(self, faults: Sequence[Fault]) -> None:
        """Use other faults from the next frame on."""
        self.present = tuple(faults)
        order = [*FAULTS, *(fault.name for fault in faults)]  # in which they strike
        seen: Counter[str] = Counter()
        self._switches = []
        for fault in sorted(faults, key=lambda fault: order.index(fault.name)):
            seen[fault.name] += 1
            self._switches.append(Switch(fault, f"{self._seed} {fault.name} {seen[fault.name]}"))
        self.receiver.use(self._switches)

    def begin(self, number: int, time_s: float) -> None:
        """Begin frame `number`; `time_s` is its instant from the start of the run."""
        time_us = round(time_s * 1e6)
        self._on = [switch for switch in self._switches if switch.turn(time_us)]
        self._number = number
        self.met = ()
        for switch in self._of_stage("heard"):
            self._meet(switch)

    def send(self, frame: Frame, t: float, boot_ms: int, encode: Callable[[Frame, int], bytes]) -> tuple[Frame, int]:
        """Put a frame into the outbox. Returns the frame after faults, and the number of its copies.

        `t`: its instant on the caller's clock [s]. `encode` gives the frame's bytes; it is called only while faults on
        the wire are on.
        """
        sending = Sending(frame, may_wait=not self.outbox.holds)
        for switch in self._of_stage("sent"):
            if sending.copies and switch.strike(sending, switch.fault.value, switch.random(self._number)):
                self._meet(switch)
        queued = [QueuedFrame(sending.frame, boot_ms)] * sending.copies
        if queued and (garblers := self._of_stage("wire")):
            queued = self._garble(queued, encode(sending.frame, boot_ms), garblers)
        self.outbox.put(queued, t + sending.late_s, sending.overtaken)
        return sending.frame, len(queued)

    def counts(self) -> dict[str, dict[str, int]]:
        """Return the number of frames and bytes that each fault changed, by its name."""
        stages = {switch.fault.name: switch.stage for switch in self._switches}
        return {
            name: {"frames": self._frames[name]} | ({"bytes": self._bytes[name]} if stage == "wire" else {})
            for name, stage in stages.items()
        }

    def _garble(self, queued: list[QueuedFrame], data: bytes, switches: list[Switch]) -> list[QueuedFrame]:
        """Return the copies after the faults on the wire. Empty ones are removed."""
        left = [data] * len(queued)
        for switch in switches:
            random, hits = switch.random(self._number), 0
            for n, copy in enumerate(left):
                left[n], hit = switch.strike(copy, switch.fault.value, random)
                hits += hit
            if hits:
                self._bytes[switch.fault.name] += hits
                self._meet(switch)
        return [one._replace(data=copy, whole=data in copy) for one, copy in zip(queued, left, strict=True) if copy]

    def _of_stage(self, stage: str) -> list[Switch]:
        return [switch for switch in self._on if switch.stage == stage]

    def _meet(self, switch: Switch) -> None:
        name = switch.fault.name
        if name not in self.met:
            self.met += (name,)
            self._frames[name] += 1
