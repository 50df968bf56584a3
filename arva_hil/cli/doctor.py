"""`arva-hil doctor`: looks at both sides as `run` would, and says in order what it finds."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, suppress
from typing import Final

from arva_hil.cli.endings import SignalGuard
from arva_hil.cli.keyfile import signing
from arva_hil.cli.next_command import next_command
from arva_hil.cli.options import DEFAULT_AUTOPILOT
from arva_hil.cli.outcome import INTERRUPTED, UsageError
from arva_hil.cli.run_links import check_sides, choose_autopilot
from arva_hil.cli.terminal import show, show_json, tell
from arva_hil.doctor import diagnosis as look
from arva_hil.doctor import port_diagnosis as port_look
from arva_hil.doctor.examination import AutopilotProbe, PortProbe
from arva_hil.doctor.held import held
from arva_hil.doctor.tcp_server import accepted
from arva_hil.doctor.values import Finding, Position
from arva_hil.emulator.formats import encoder
from arva_hil.links import Address, Link, LinkError, open_link, parse
from arva_hil.links.serial_ports import SerialPort as SerialPort
from arva_hil.links.serial_ports import far_program, list_ports
from arva_hil.mavlink.signing import Signing
from arva_hil.observers.console.text import BAD, DOUBTFUL, GOOD, coloured, wants_colour
from arva_hil.registry import MAVLINK_FORMATS
from arva_hil.runtime.clock import Clock, RealClock
from arva_hil.runtime.loop import run
from arva_hil.vehicle.session import Session

BAUDS: Final = (57600, 921600, 115200, 38400, 230400, 460800, 500000, 1500000)
_TRY_S: Final = 1.3  # for each baud rate: a heartbeat comes within
_ANSWER_S: Final = 2.0  # for a vehicle to stream what it is asked for
_STAYS: Final = ("permission denied", "busy", "refused")  # cured elsewhere: the option is right
_COLOURS: Final = {"ok": GOOD, "note": DOUBTFUL, "fail": BAD}


def main(options: argparse.Namespace) -> int:
    address = options.autopilot or choose_autopilot(options.port)
    check_sides(address, options.port, options.format)
    if options.port == "-":
        raise UsageError("--port -: is stdout, where the findings go; `run` can send frames there")
    report, guard, clock = FindingsReport(as_json=options.json), SignalGuard(), RealClock()
    with ExitStack() as stack, guard:
        key = signing(options.signing_key, clock.epoch_us, stack, link=1)  # `run` may go on at the same time
        Doctor(options, address, report, clock, stack, lambda: guard.caught is not None, key).examine()
    return INTERRUPTED if guard.caught else look.exit_code(report.findings)


class FindingsReport:
    """Prints findings as they are known, and remembers them."""

    def __init__(self, *, as_json: bool) -> None:
        self.findings: list[Finding] = []
        self._as_json = as_json
        self._colour = wants_colour(sys.stdout)

    def add(self, finding: Finding | None) -> None:
        if finding is None:
            return
        self.findings.append(finding)
        if self._as_json:
            show_json(finding._asdict())
            return
        state = f"{'FAIL' if finding.state == 'fail' else finding.state:<4}"
        if self._colour:
            state = coloured(state, _COLOURS[finding.state])
        show(f"  {finding.check:<19}  {finding.found}" + (f" → {finding.cure}" if finding.cure else ""), mark=state)


class Doctor:
    """One examination: remembers both links and what was seen of them. `stack` closes them."""

    def __init__(
        self,
        options: argparse.Namespace,
        address: str,
        report: FindingsReport,
        clock: Clock,
        stack: ExitStack,
        stopped: Callable[[], bool],
        key: Signing | None,
    ) -> None:
        self._options = options
        self._report = report
        self._clock = clock
        self._stack = stack
        self._stopped = stopped
        self._key = key
        self._address = address
        self._autopilot = parse(address)
        self._out: Link | None = None
        self._mouth: PortProbe | None = None
        self._right: dict[str, str | None] = {}  # instead of options that were found wrong, by name

    def examine(self) -> None:
        """All of it, to the verdict, unless it is stopped."""
        self._say_autopilot()
        link = self._open(self._autopilot, "link", answered=True)
        self._out = self._open_port()
        ear = self._listen(link)
        if ear and not self._stopped():
            ear = self._judge_packets(ear) or ear
        if ear and not self._stopped() and ear.known:
            self._judge_vehicle(ear)
        if self._stopped():
            return
        if self._mouth:
            way = self._mouth.way()
            self._report.add(port_look.frames(way, self._options.format))
            self._report.add(port_look.reader(way))
        usb = [port.device for port in _candidates(self._autopilot) if port.usb and port.device != self._options.port]
        if self._right.get("port") and len(usb) == 1:
            self._right["port"] = usb[0]
        command = next_command(self._options, str(self._autopilot), usb, self._right)
        self._report.add(look.verdict(self._report.findings, command))

    # -- opening ---------------------------------------------------------------------------------------------

    def _say_autopilot(self) -> None:
        if self._options.autopilot:
            why = "as asked" if self._autopilot.kind != "tlog" else "a log, played in real time; nobody can ask it"
        elif self._address == DEFAULT_AUTOPILOT:
            why = "none is on USB, so the port where ground stations listen"
        else:
            named = {port.device: port.description or port.usb for port in list_ports()}
            why = f"on USB: {named.get(self._address, '')}"
        self._report.add(Finding("autopilot", "ok", f"{self._address}, {why}"))

    def _open(self, address: Address, check: str, *, answered: bool = False) -> Link | None:
        """A link, which is a finding; None, which is another."""
        far = far_program(address.path) if check == "port" and address.kind == "serial" else ""
        if finding := held(check, str(address), far):
            self._report.add(finding)
            return None
        try:
            link = self._stack.enter_context(closing(open_link(address, clock=self._clock, answered=answered)))
        except LinkError as error:
            ours = held(check, error.link, error.what)
            self._report.add(ours or Finding(check, "fail", f"{error.link}: {error.what}", error.hint))
            if not ours and not any(cause in error.what for cause in _STAYS):
                self._right["port" if check == "port" else "autopilot"] = "URL"
            return None
        self._report.add(Finding(check, "ok", f"{link.name} is open"))
        return link

    def _open_port(self) -> Link | None:
        if self._options.port:
            return self._open(parse(self._options.port), "port")
        if self._options.format not in MAVLINK_FORMATS:
            ports = _candidates(self._autopilot)
            usb = [port.device for port in ports if port.usb]
            self._report.add(port_look.no_port([port.device for port in ports], usb))
        return None

    # -- listening -------------------------------------------------------------------------------------------

    def _session(self) -> Session:
        return Session(
            target_system=self._options.target_system,
            target_component=self._options.target_component,
            rate_hz=self._options.stream_rate,
            passive=self._autopilot.kind == "tlog",
            signing=self._key,
        )

    def _listen(self, link: Link | None) -> AutopilotProbe | None:
        """Hear the autopilot and send frames, for a while."""
        ear = AutopilotProbe(link, self._session(), self._clock.now(), self._first_bytes) if link else None
        if mouth := self._new_mouth(ear, link):
            self._mouth = mouth
        if tasks := [task for task in (ear, self._mouth) if task]:
            tell(f"listening for {self._options.listen:g} s")
            self._attend(tasks, ear)
        return ear

    def _new_mouth(self, ear: AutopilotProbe | None, link: Link | None) -> PortProbe | None:
        """Who sends frames while the autopilot's link is this one; None where they are sent already, or cannot be."""
        over_mavlink = self._options.format in MAVLINK_FORMATS
        out = link if over_mavlink else self._out
        if out is None or (self._mouth and not over_mavlink):
            return None
        session = ear.session if ear else self._session()
        address = None if over_mavlink else parse(self._options.port)
        return PortProbe(encoder(self._options.format, session), out, address, self._clock.now())

    def _attend(self, tasks: Sequence[AutopilotProbe | PortProbe], ear: AutopilotProbe | None) -> None:
        """Serve both sides for as long as asked; a vehicle found late is given the time to answer."""
        seconds, start = self._options.listen, self._clock.now()

        def enough() -> bool:
            late = ear.followed_at + min(seconds, _ANSWER_S) if ear and ear.session.vehicle else start
            return (ear is not None and ear.over) or self._clock.now() >= max(start + seconds, late)

        run(tasks, self._clock, stopped=lambda: self._stopped() or enough())

    def _first_bytes(self, after_s: float) -> None:
        self._report.add(Finding("bytes", "ok", f"the first came after {after_s:.1f} s"))

    def _judge_packets(self, ear: AutopilotProbe, *, again: bool = False) -> AutopilotProbe | None:
        """Bytes, packets, baud; the ear that listened `again`, at a rate that brings packets."""
        now, session = self._clock.now(), ear.session
        if not session.reader.bytes:
            taken = accepted(self._autopilot.port) if self._autopilot.kind == "tcp" and self._autopilot.port else None
            self._report.add(look.silence(self._autopilot.kind, now - ear.start, refused=ear.refused, accepted=taken))
            if taken is False:
                self._right["autopilot"] = "URL"
        if ear.lost:
            self._report.add(Finding("link", "fail", ear.lost))
        if not session.reader.bytes:
            return None
        if ear.known:
            traffic = ear.traffic(now)
            self._report.add(look.packets(traffic))
            self._report.add(signatures := look.signing(traffic))
            if signatures.state == "fail":
                self._right["signing_key"] = "FILE"
            self._report.add(look.strangers(*ear.strangers))
            return None
        self._report.add(look.garbage(self._autopilot.kind, session.reader.bytes, bytes(ear.sample)))
        if self._autopilot.kind != "serial" or ear.lost or again:
            return None
        ear.close()
        found = self._sweep()
        if self._stopped() or found is None:
            return None
        self._autopilot = self._autopilot._replace(baud=found)
        link = self._open(self._autopilot, "link", answered=True)
        if link is None:
            return None
        heard = self._listen(link)
        if heard and not self._stopped():
            self._judge_packets(heard, again=True)
        return heard

    def _sweep(self) -> int | None:
        """The baud rate at which there are packets."""
        asked = self._autopilot.baud or 115200
        rates = [asked, *(baud for baud in BAUDS if baud != asked)]
        found = None
        each = min(_TRY_S, self._options.listen)
        tell(f"trying other baud rates, {each:g} s each")
        for baud in rates[1:]:
            with suppress(LinkError):  # a rate that this adapter does not know
                with closing(open_link(self._autopilot._replace(baud=baud), clock=self._clock)) as link:
                    ear = AutopilotProbe(link, self._session(), self._clock.now())
                    self._try(ear, each)
                if ear.known:
                    found = baud
            if found or self._stopped():
                break
        if not self._stopped():
            self._report.add(look.baud(self._autopilot.path, rates, found))
        return found

    def _try(self, ear: AutopilotProbe, seconds: float) -> None:
        """Listen until there is a packet."""
        until = self._clock.now() + seconds
        run([ear], self._clock, until=until, stopped=lambda: self._stopped() or ear.over or ear.known > 0)

    # -- the vehicle -----------------------------------------------------------------------------------------

    def _judge_vehicle(self, ear: AutopilotProbe) -> None:
        now, session = self._clock.now(), ear.session
        vehicle = session.vehicle
        if vehicle is None and any((session.disbelieved_signatures() or {}).values()):
            return
        followed = (vehicle.system, vehicle.component) if vehicle else None
        target = (self._options.target_system, self._options.target_component)
        add = self._report.add
        add(look.heartbeat(ear.sources(), followed, target))
        if vehicle is None:
            self._right |= look.target(ear.sources())
            return
        streams = ear.streams(now, self._options.stream_rate, recorded=self._autopilot.kind == "tlog")
        for stream in streams:
            add(look.stream(stream))
        if (slow := look.slowest(streams)) is not None:
            self._right["stream_rate"] = str(slow)
        last = session.track.last_position
        place = (last.lat, last.lon, last.alt) if last else None
        add(look.position(Position(place, session.navigation.unpositioned, session.navigation.refused, ear.fix)))
        add(look.home(session.home, armed=vehicle.armed))
        state = session.state_at(now, last.frame) if last else None
        add(look.pose(state.age_s if state else None))
        add(look.clock(ear.lags(now), session.navigation.reboots))


def _candidates(autopilot: Address) -> list[SerialPort]:
    """Serial ports that no autopilot is at."""
    taken = os.path.realpath(autopilot.path)
    return [port for port in list_ports() if not port.autopilot and port.device != taken]
