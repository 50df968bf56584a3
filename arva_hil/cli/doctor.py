"""`arva-hil doctor`: examines both links as `run` would use them, and prints findings."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from arva_hil.autopilot.following.session import Session
from arva_hil.cli.diagnosis import diagnosis
from arva_hil.cli.diagnosis.examination import AutopilotProbe, PortProbe
from arva_hil.cli.options import DEFAULT_AUTOPILOT
from arva_hil.cli.outcome import INTERRUPTED, SignalGuard, UsageError
from arva_hil.cli.run_links import check_sides, choose_autopilot, next_command, session, signing
from arva_hil.cli.terminal import show_json, show_marked, tell
from arva_hil.clock import Clock, RealClock
from arva_hil.emulator.ports import encoder
from arva_hil.events.words.text import BAD, DOUBTFUL, GOOD, coloured, wants_colour
from arva_hil.links import Address, Link, LinkError, open_link, parse
from arva_hil.links.processes import accepted, far_program
from arva_hil.links.serial_ports import SerialPort, list_ports
from arva_hil.mavlink.signing import Signing
from arva_hil.registry import over_mavlink
from arva_hil.runtime.loop import run

BAUDS: Final = (57600, 921600, 115200, 38400, 230400, 460800, 500000, 1500000)
_TRY_S: Final = 1.3  # listen to each baud rate for this time, in which a heartbeat comes
_ANSWER_S: Final = 2.0  # wait this long for requested streams
_STAYS: Final = ("permission denied", "busy", "refused")  # the option is right; the cure is elsewhere
_FOUND_AT: Final = 27  # column of the findings
_COLOURS: Final = {"ok": GOOD, "note": DOUBTFUL, "fail": BAD}


def main(options: argparse.Namespace) -> int:
    address = options.autopilot or choose_autopilot(options.port)
    check_sides(address, options.port, options.format)
    if options.port == "-":
        raise UsageError("--port -: this is stdout, where the findings go; `run` can send frames there")
    guard, clock = SignalGuard(), RealClock()
    with ExitStack() as stack, guard:
        key = signing(options.signing_key, clock.epoch_us, stack, link=1)  # `run` may use the key at the same time
        doctor = Doctor(options, parse(address), clock, stack, lambda: guard.caught is not None, key)
        doctor.examine()
    return INTERRUPTED if guard.caught else diagnosis.exit_code(doctor.findings)


@dataclass
class Doctor:
    """One examination of the links.

    Remembers the links, the findings, and the right values of wrong options. `stack` closes the links.
    """

    options: argparse.Namespace
    autopilot: Address
    clock: Clock
    stack: ExitStack
    stopped: Callable[[], bool]
    key: Signing | None
    out: Link | None = None
    port_probe: PortProbe | None = None
    right: dict[str, str | None] = field(default_factory=dict)
    findings: list[diagnosis.Finding] = field(default_factory=list)

    def _add(self, finding: diagnosis.Finding | None) -> None:
        """Print a finding at once, and remember it."""
        if finding is None:
            return
        self.findings.append(finding)
        if self.options.json:
            show_json(finding._asdict())
            return
        show_marked(
            f"{'FAIL' if finding.state == 'fail' else finding.state:<4}",
            f"  {finding.check:<19}  {finding.found}" + (f" → {finding.cure}" if finding.cure else ""),
            paint=partial(coloured, colour=_COLOURS[finding.state]) if wants_colour(sys.stdout) else str,
            further=_FOUND_AT,
        )

    def examine(self) -> None:
        """Examine everything and print the verdict, unless it is stopped."""
        self._say_autopilot()
        link = self._open(self.autopilot, "link", answered=True)
        if self.options.port:
            self.out = self._open(parse(self.options.port), "port")
        elif not over_mavlink(self.options.format):
            self._add(diagnosis.no_port(_candidates(self.autopilot)))
        probe = self._listen(link)
        if probe and not self.stopped():
            probe = self._judge_packets(probe) or probe
        if probe and not self.stopped() and probe.packets["known"]:
            self._judge_vehicle(probe)
        if self.stopped():
            return
        if self.port_probe:
            traffic = self.port_probe.traffic()
            self._add(diagnosis.frames(traffic, self.options.format))
            self._add(diagnosis.reader(traffic))
        usb = [port.device for port in _candidates(self.autopilot) if port.usb and port.device != self.options.port]
        if self.right.get("port") and len(usb) == 1:
            self.right["port"] = usb[0]
        self._add(diagnosis.verdict(self.findings, next_command(self.options, str(self.autopilot), usb, self.right)))

    def _say_autopilot(self) -> None:
        if self.options.autopilot:
            why = "as asked" if self.autopilot.kind != "tlog" else "a log, played in real time; it answers no requests"
        elif str(self.autopilot) == DEFAULT_AUTOPILOT:
            why = "the usual port of ground stations, because there is no autopilot on USB"
        else:
            named = {port.device: port.description or port.usb for port in list_ports()}
            why = f"on USB: {named.get(str(self.autopilot), '')}"
        self._add(diagnosis.Finding("autopilot", "ok", f"{self.options.autopilot or self.autopilot}, {why}"))

    def _open(self, address: Address, check: str, *, answered: bool = False) -> Link | None:
        """Open a link, and add a finding; None if it cannot be opened."""
        far = far_program(address.path) if check == "port" and address.kind == "serial" else ""
        if finding := diagnosis.held(check, str(address), far):
            self._add(finding)
            return None
        try:
            link = self.stack.enter_context(closing(open_link(address, clock=self.clock, answered=answered)))
        except LinkError as error:
            ours = diagnosis.held(check, error.link, error.what)
            self._add(ours or diagnosis.Finding(check, "fail", f"{error.link}: {error.what}", error.hint))
            if not ours and not any(cause in error.what for cause in _STAYS):
                self.right["port" if check == "port" else "autopilot"] = "URL"
            return None
        self._add(diagnosis.Finding(check, "ok", f"{link.name} is open"))
        return link

    def _session(self) -> Session:
        return session(self.options, passive=self.autopilot.kind == "tlog", signing=self.key)

    def _listen(self, link: Link | None) -> AutopilotProbe | None:
        """Read the autopilot's link and send frames, for the time of --listen."""

        def first(after_s: float) -> None:
            self._add(diagnosis.Finding("bytes", "ok", f"the first came after {after_s:.1f} s"))

        probe = AutopilotProbe(link, self._session(), self.clock.now(), first) if link else None
        self.port_probe = self._new_port_probe(probe, link) or self.port_probe
        seconds, start = self.options.listen, self.clock.now()

        def enough() -> bool:
            """Return True after the time of --listen. A vehicle that is found late gets time to answer."""
            late = probe.followed_at + min(seconds, _ANSWER_S) if probe and probe.session.vehicle else start
            return (probe is not None and probe.over) or self.clock.now() >= max(start + seconds, late)

        if tasks := [task for task in (probe, self.port_probe) if task]:
            tell(f"listening for {seconds:g} s")
            run(tasks, self.clock, stopped=lambda: self.stopped() or enough())
        return probe

    def _new_port_probe(self, probe: AutopilotProbe | None, link: Link | None) -> PortProbe | None:
        """Return a probe that sends frames; None if there is one already, or if there is no link for it."""
        inside = over_mavlink(self.options.format)
        out = link if inside else self.out
        if out is None or (self.port_probe and not inside):
            return None
        session = probe.session if probe else self._session()
        address = None if inside else parse(self.options.port)
        return PortProbe(encoder(self.options.format, session), out, address, self.clock.now())

    def _judge_packets(self, probe: AutopilotProbe, *, again: bool = False) -> AutopilotProbe | None:
        """Judge bytes and packets, and try other baud rates. Returns the probe at the rate that brings packets."""
        now, session = self.clock.now(), probe.session
        if not session.reader.bytes:
            taken = accepted(self.autopilot.port) if self.autopilot.kind == "tcp" and self.autopilot.port else None
            self._add(
                diagnosis.silence(
                    self.autopilot.kind, now - probe.start, refused=probe.link.refusals > 0, accepted=taken
                )
            )
            if taken is False:
                self.right["autopilot"] = "URL"
        if probe.lost:
            self._add(diagnosis.Finding("link", "fail", probe.lost))
        if not session.reader.bytes:
            return None
        if probe.packets["known"]:
            traffic = probe.traffic(now)
            self._add(diagnosis.packets(traffic))
            self._add(signatures := diagnosis.signing(traffic))
            if signatures.state == "fail":
                self.right["signing_key"] = "FILE"
            self._add(diagnosis.other_senders(probe.link.strangers, probe.link.stranger))
            return None
        self._add(diagnosis.garbage(self.autopilot.kind, session.reader.bytes, bytes(probe.sample)))
        if self.autopilot.kind != "serial" or probe.lost or again:
            return None
        probe.close()
        found = self._sweep()
        if self.stopped() or found is None:
            return None
        self.autopilot = self.autopilot._replace(baud=found)
        link = self._open(self.autopilot, "link", answered=True)
        heard = self._listen(link) if link else None
        if heard and not self.stopped():
            self._judge_packets(heard, again=True)
        return heard

    def _sweep(self) -> int | None:
        """Try other baud rates; returns the one at which packets come, or None."""
        asked = self.autopilot.baud or 115200
        rates = [asked, *(baud for baud in BAUDS if baud != asked)]
        each = min(_TRY_S, self.options.listen)
        tell(f"trying other baud rates, {each:g} s each")
        found = next((one for one in rates[1:] if not self.stopped() and self._brings_packets(one, each)), None)
        if not self.stopped():
            self._add(diagnosis.baud(self.autopilot.path, rates, found))
        return found

    def _brings_packets(self, baud: int, seconds: float) -> bool:
        with (
            suppress(LinkError),  # this adapter does not support the rate
            closing(open_link(self.autopilot._replace(baud=baud), clock=self.clock)) as link,
        ):
            probe = AutopilotProbe(link, self._session(), self.clock.now())
            run(
                [probe],
                self.clock,
                until=probe.start + seconds,
                stopped=lambda: self.stopped() or probe.over or probe.packets["known"] > 0,
            )
            return probe.packets["known"] > 0
        return False

    def _judge_vehicle(self, probe: AutopilotProbe) -> None:
        now, session, vehicle = self.clock.now(), probe.session, probe.session.vehicle
        if vehicle is None and any((session.disbelieved_signatures() or {}).values()):
            return
        followed = (vehicle.system, vehicle.component) if vehicle else None
        target, add = (self.options.target_system, self.options.target_component), self._add
        add(diagnosis.heartbeat(probe.sources(), followed, target))
        if vehicle is None:
            self.right |= diagnosis.target(probe.sources())
            return
        streams = probe.streams(now, self.options.stream_rate, recorded=self.autopilot.kind == "tlog")
        for stream in streams:
            add(diagnosis.stream(stream))
        if (slow := diagnosis.slowest(streams)) is not None:
            self.right["stream_rate"] = str(slow)
        last = session.navigation.track.last_position
        place = (last.lat, last.lon, last.alt) if last else None
        add(diagnosis.position(place, session.navigation.unpositioned, session.navigation.refused, probe.messages.fix))
        add(diagnosis.home(session.navigation.home, armed=vehicle.armed))
        state = session.navigation.state_at(now, last.frame) if last else None
        add(diagnosis.pose(state.age_s if state else None))
        add(diagnosis.clock(probe.messages.lags(now), session.navigation.reboots))


def _candidates(autopilot: Address) -> list[SerialPort]:
    """Return serial ports without an autopilot."""
    taken = os.path.realpath(autopilot.path)
    return [port for port in list_ports() if not port.autopilot and port.device != taken]
