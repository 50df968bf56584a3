"""Turns measurements of the autopilot's link into findings with cures. Pure functions.

`arva-hil doctor` makes the measurements. Parameters: https://ardupilot.org/copter/docs/parameters.html,
https://docs.px4.io/main/en/advanced_config/parameter_reference.html
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from arva_hil.links.serial_ports import SerialPort

State = Literal["ok", "note", "fail"]


class Finding(NamedTuple):
    """One line: what was checked, its state, what was found, and the cure if there is a problem."""

    check: str
    state: State
    found: str
    cure: str = ""


def noted(check: str, found: str, cure: str, *, wrong: bool) -> Finding:
    """Return a note with a cure if something is wrong."""
    return Finding(check, "note", found, cure) if wrong else Finding(check, "ok", found)


@dataclass(frozen=True, slots=True)
class Traffic:
    """All packets on the link, in `seconds`."""

    seconds: float
    size: int  # bytes
    packets: int
    old: int  # MAVLink 1 packets among them
    signed: int
    bad: int  # checksums
    refused: Mapping[str, int] | None = None  # packets refused for their signature, by reason; None without a key


@dataclass(slots=True, eq=False)
class Source:
    """A sender of heartbeats. `hz`: None if only one came; `pilot`: whether it is an autopilot."""

    system: int
    component: int
    name: str
    pilot: bool
    count: int
    hz: float | None
    first_s: float = 0.0  # when the first one came

    def __str__(self) -> str:
        rate = f" at {self.hz:.1f} Hz" if self.hz is not None else ""
        return f"{self.name} {self.system}/{self.component} ×{self.count}{rate}"


@dataclass(frozen=True, slots=True)
class StreamRate:
    """One kind of pose message. `hz`: its rate lately; `said`: the vehicle's answer to the request.

    `promised`: whether the vehicle accepted the request.
    """

    name: str
    count: int
    hz: float
    wanted_hz: float
    said: str = ""
    recorded: bool = False  # it comes from a log, so no request is possible
    promised: bool = False


@dataclass(slots=True)
class PortTraffic:
    """Traffic on the port. `kind`: a link's, or mavlink; `seen`: programs at the other end; `unread`: bytes there."""

    kind: str
    name: str
    taken: int = 0
    dropped: int = 0
    answered: int = 0  # bytes that came back
    seen: Sequence[str] = ()
    unread: int = 0
    refused: bool = False  # by the far machine: no program listens there
    lost: str = ""


ENOUGH: Final = 0.7  # share of the requested rate; below it the session requests the stream again
MAX_AGE_S: Final = 2.0  # of a pose, the default of `run`
_BAD_SHARE: Final = 0.02  # report a larger share of bad checksums
_LATE_S: Final = 0.2  # report poses that come this much later than the quickest
_SLOW_HEARTBEAT_HZ: Final = 0.6
_PRINTABLE: Final = frozenset(range(32, 127)) | {9, 10, 13}
_NO_LINK: Final = frozenset(("link", "port", "bytes", "packets", "baud", "signing", "heartbeat"))

_SERIAL_CURE: Final = (
    "ArduPilot: SERIALn_PROTOCOL 2, SERIALn_BAUD; PX4: MAV_n_CONFIG names the port, SER_*_BAUD, on USB SYS_USB_AUTO 2"
)
_SIGNING_CURE: Final = "ArduPilot: in MAVProxy signing setup KEY, signing remove KEY; PX4: v1.16 does not sign"
_STREAM_CURE: Final = {
    "GLOBAL_POSITION_INT": "ArduPilot: SRn_POSITION (from 4.7 on MAVn_POSITION); "
    "PX4: MAV_n_MODE 2 (onboard), MAV_n_RATE, or mavlink stream -d DEVICE -s GLOBAL_POSITION_INT -r 50",
    "ATTITUDE": "ArduPilot: SRn_EXTRA1 (from 4.7 on MAVn_EXTRA1); "
    "PX4: MAV_n_MODE 2 (onboard), MAV_n_RATE, or mavlink stream -d DEVICE -s ATTITUDE -r 50",
}
_FIX_CURE: Final = (
    "wait for GPS under an open sky, a minute when cold, indoors forever; ArduPilot: GPS1_TYPE, in SITL 10 s after "
    "boot; PX4: GPS_1_CONFIG, EKF2_GPS_CTRL, listener vehicle_gps_position"
)
_SILENT_CURE: Final = {
    "serial": f"is it powered, is RX connected to TX, does the cable have data lines? {_SERIAL_CURE}",
    "udpin": "ArduPilot: SITL sends here with --serial1 udpclient:HOST:PORT, MAVProxy with --out HOST:PORT; "
    "PX4: SITL sends to 14550 and 14540, each to the first program that answered, and to 14030 at 8 Hz: take a free "
    "port, restart SITL, or let the ground station forward (QGroundControl: to udpin:127.0.0.1:14445)",
    "udpout": "does the autopilot listen there? ArduPilot: NET_Pn_TYPE UDP server; PX4: MAV_n_UDP_PRT, SITL 18570",
    "tcp": "ArduPilot: each port has one client, perhaps another program, or SERIALn_PROTOCOL is not 2 (MAVLink 2); "
    "SITL has tcp:127.0.0.1:5760, 5762 and 5763; PX4: speaks UDP, not TCP",
    "tcpin": "no client sends anything; ArduPilot: NET_Pn_TYPE TCP client, in SITL --serial1 tcpclient:HOST:PORT; "
    "PX4: speaks UDP, not TCP",
    "pty": "give the path of this pty to the autopilot's program; ArduPilot: SITL --serial1 uart:PATH",
    "tlog": "is it a MAVLink telemetry log?",
}
_OTHER_PROTOCOLS: Final = (  # the bytes of a protocol → its name
    (rb"\xa4\x57\x01", "frames of a receiver, as arva-hil sends them: is this the other port?"),
    (rb"\xb5\x62[\x01\x02\x0a]", "u-blox: a GPS receiver"),
    (rb"\$G[A-Z]{4},", "NMEA: a GPS receiver"),
    (rb"nsh>", "PX4's shell"),
)


def rate(times: Iterable[float], now: float) -> float:
    """Return messages per second in the last 2 s; 0 if there are fewer than two."""
    recent = [t for t in times if t > now - 2.0]
    return (len(recent) - 1) / (now - recent[0]) if len(recent) > 1 and now > recent[0] else 0.0


def silence(kind: str, seconds: float, *, refused: bool = False, accepted: bool | None = None) -> Finding:
    """Judge a link without any byte.

    `accepted`: whether a TCP server has accepted the connection; None if that is not known.
    """
    found = f"no byte came in {seconds:.1f} s"
    if refused:
        found += ": no program listens there"
    if accepted is False:
        return Finding(
            "bytes",
            "fail",
            f"{found}: the connection is not accepted, because another client has the port",
            "ArduPilot: a port has one client: take another one, SITL has tcp:127.0.0.1:5760, 5762 and 5763; PX4: "
            "speaks UDP, not TCP",
        )
    if accepted:
        return Finding(
            "bytes",
            "fail",
            f"{found}: the connection is accepted, but nothing is sent on it",
            "is it a MAVLink port? ArduPilot: SERIALn_PROTOCOL 2, in SITL SERIAL0 is 5760, SERIAL1 5762, SERIAL2 5763; "
            "PX4: speaks UDP, not TCP",
        )
    return Finding("bytes", "fail", found, _SILENT_CURE.get(kind, _SERIAL_CURE))


def garbage(kind: str, size: int, sample: bytes) -> Finding:
    """Judge bytes without a packet. `sample`: the first bytes."""
    found = f"none in {size} bytes"
    for mark, who in _OTHER_PROTOCOLS:
        if re.search(mark, sample):
            return Finding("packets", "fail", f"{found}, but {who}", _SERIAL_CURE)
    if sample and sum(byte in _PRINTABLE for byte in sample) > 0.9 * len(sample):
        begins = " ".join(sample.decode("ascii", "replace").split())[:60]
        return Finding("packets", "fail", f"{found}, but plain text: {begins!r}", _SERIAL_CURE)
    cure = _SERIAL_CURE if kind in ("serial", "pyserial") else f"does the sender send MAVLink? {_SERIAL_CURE}"
    return Finding("packets", "fail", found, cure)


def baud(device: str, tried: Sequence[int], found: int | None) -> Finding:
    """Judge a serial port whose first rate of `tried` gave bytes without packets.

    `found`: the rate that brought packets, or None.
    """
    if found is None:
        rates = ", ".join(map(str, tried))
        return Finding(
            "baud", "fail", f"no MAVLink at {rates}", f"the port's protocol is probably not MAVLink: {_SERIAL_CURE}"
        )
    return Finding("baud", "fail", f"{found} brings packets, {tried[0]} does not", f"--autopilot {device},{found}")


def packets(t: Traffic) -> Finding:
    """Judge the number of packets, their MAVLink version, and the number of bad checksums."""
    versions = {0: "MAVLink 2", t.packets: "MAVLink 1"}.get(t.old, f"MAVLink 2, {t.old} of them MAVLink 1")
    found = f"{t.packets} in {t.seconds:.1f} s, {t.size / 1000 / t.seconds:.1f} kB/s, {versions}"
    share = t.bad / (t.bad + t.packets)
    found += f", {share:.1%} bad checksums" if t.bad else ", no bad checksums"
    return noted(
        "packets",
        found,
        "bytes are damaged: use a shorter cable, a lower baud rate or flow control (ArduPilot: BRD_SERn_RTSCTS; "
        "PX4: MAV_n_FLOW_CTRL)",
        wrong=t.bad > 2 and share > _BAD_SHARE,
    )


def signing(t: Traffic) -> Finding:
    """Judge whether the vehicle signs, and whether with the key that was given."""
    if t.refused is None:
        if not t.signed:
            return Finding("signing", "ok", "not signed")
        found = f"{t.signed} of {t.packets} packets are signed: the vehicle may refuse unsigned requests"
        return Finding("signing", "note", found, f"--signing-key FILE, or clear the vehicle's key; {_SIGNING_CURE}")
    good = t.packets - sum(t.refused.values())
    why = ", ".join(f"{count} {name}" for name, count in t.refused.items() if count)
    if not good:
        return Finding(
            "signing",
            "fail",
            f"every packet is ignored: {why}",
            f"give the vehicle the same key, or leave out --signing-key; {_SIGNING_CURE}",
        )
    if why:
        found = f"{good} of {t.packets} packets are signed with the key; ignored: {why}"
        return Finding("signing", "note", found, "who else sends on this link?")
    return Finding("signing", "ok", f"all {good} packets are signed with the key")


def other_senders(count: int, first: str) -> Finding | None:
    """Return datagrams of other senders than the vehicle at a UDP port; None if there are none."""
    if not count:
        return None
    return Finding(
        "strangers",
        "note",
        f"{count} datagrams of other senders are ignored; the first was from {first}",
        "only bytes from the vehicle's address are read",
    )


def heartbeat(
    sources: Sequence[Source], followed: tuple[int, int] | None, target: tuple[int | None, int | None]
) -> Finding:
    """Judge the senders of heartbeats. `followed`, `target`: system and component followed and asked for."""
    pilots = [s for s in sources if s.pilot]
    heard = ", ".join(map(str, sources))
    if not sources:
        cure = "a program that forwards this link must forward HEARTBEAT too; " + _SERIAL_CURE
        return Finding("heartbeat", "fail", "none from anybody", cure)
    if not pilots:
        cure = (
            "forward the vehicle here (MAVProxy: output add HOST:PORT; QGroundControl: Application Settings, MAVLink, "
            "forwarding), or use another port of the vehicle (ArduPilot: SITL tcp:127.0.0.1:5762; "
            "PX4: SITL udpin:127.0.0.1:14540)"
        )
        return Finding("heartbeat", "fail", f"none from an autopilot, only {heard}", cure)
    if followed is None:
        asked = "/".join("any" if n is None else str(n) for n in (target[0], target[1] or 1))
        return Finding("heartbeat", "fail", f"none from {asked}, but {heard}", _choose(pilots))
    mine = next((s for s in pilots if (s.system, s.component) == followed), pilots[0])
    rest = [str(s) for s in sources if s is not mine]
    found = f"{mine} is followed" + (f"; also {', '.join(rest)}" if rest else "")
    if len(pilots) > 1 and target[0] is None:
        return Finding("heartbeat", "note", found, f"it sent the first heartbeat; choose with {_choose(pilots)}")
    return noted(
        "heartbeat",
        found,
        "one a second is usual: the link loses packets or is too slow",
        wrong=mine.hz is not None and mine.hz < _SLOW_HEARTBEAT_HZ,
    )


def target(sources: Sequence[Source]) -> dict[str, str | None]:
    """Return the options that choose one of the autopilots found; N if there are several."""
    pilots = [s for s in sources if s.pilot]
    if len(pilots) != 1:
        return {"target_system": "N", "target_component": None} if pilots else {}
    component = str(pilots[0].component) if pilots[0].component != 1 else None
    return {"target_system": str(pilots[0].system), "target_component": component}


def _choose(pilots: Sequence[Source]) -> str:
    """Return the options that name each of the autopilots."""
    component = {s: f" --target-component {s.component}" if s.component != 1 else "" for s in pilots}
    return " or ".join(f"--target-system {s.system}{component[s]}" for s in pilots)


def stream(s: StreamRate) -> Finding:
    """Judge whether a pose message comes, and at the requested rate."""
    said = f" ({s.said})" if s.said else ""
    cure = "" if s.recorded else _STREAM_CURE.get(s.name, "")
    if not s.count:
        if s.promised and s.name == "GLOBAL_POSITION_INT":
            cure = f"the vehicle accepted to send it: PX4 sends no position before it has one; {cure}"
        return Finding(s.name, "fail", f"none came{said}", cure)
    if not s.hz:
        return Finding(s.name, "fail", f"{s.count} came, none in the last 2 s{said}", cure)
    found = f"{s.hz:.1f} Hz, {s.wanted_hz:g} were asked for"
    if s.recorded:
        return Finding(s.name, "ok", f"{s.hz:.1f} Hz, as recorded")
    if slow := slowest([s]):
        return Finding(s.name, "note", found + said, f"--stream-rate {slow}, or a faster link; {cure}")
    return Finding(s.name, "ok", found)


def slowest(streams: Sequence[StreamRate]) -> int | None:
    """Return the rate to ask for [Hz] if a stream is much slower than requested; None if all are fast enough."""
    slow = [s.hz for s in streams if s.hz and not s.recorded and s.hz < ENOUGH * s.wanted_hz]
    return max(1, round(min(slow))) if slow else None


def position(place: tuple[float, float, float] | None, zeros: int, refused: int, fix: str = "") -> Finding:
    """Judge whether the vehicle knows its position: degrees, degrees, metres AMSL.

    `zeros`, `refused`: the numbers of messages without a position, and with an impossible one. `fix`: the fix type of
    GPS_RAW_INT, if it comes.
    """
    fix = fix and f", {fix}"
    if place:
        return Finding("position", "ok", _lla(place) + fix)
    if zeros:
        return Finding("position", "fail", f"all zeros in {zeros} messages: no GPS fix yet{fix}", _FIX_CURE)
    if refused:
        return Finding(
            "position",
            "fail",
            f"out of range in {refused} messages{fix}",
            "is the estimator healthy? reboot the autopilot",
        )
    return Finding("position", "fail", f"unknown: no GLOBAL_POSITION_INT came{fix}", _FIX_CURE)


def home(place: tuple[float, float, float] | None, *, armed: bool) -> Finding:
    """Judge whether the vehicle's home is known, for `datum: home`."""
    state = "armed" if armed else "not armed"
    if place:
        return Finding("home", "ok", f"{_lla(place)}, {state}")
    return Finding(
        "home",
        "note",
        f"not known yet, {state}",
        "`run` takes the first valid position after 5 s; wait for the estimator to settle (ArduPilot: 20 s after boot; "
        "PX4: commander check), or give a datum in the scenario",
    )


def pose(age_s: float | None) -> Finding:
    """Judge whether a frame made now would have a pose. `age_s`: the age of its older part [s], None without a pose."""
    if age_s is None:
        return Finding("pose", "fail", "none: position and attitude are both needed", "see the lines above")
    if age_s > MAX_AGE_S:
        return Finding("pose", "fail", f"{age_s:.1f} s old, too old to be used", "the streams have stopped, see above")
    return Finding("pose", "ok", f"there is one, {1e3 * age_s:.0f} ms old")


def clock(lags_s: Sequence[float], reboots: int) -> Finding:
    """Judge the delay of pose messages by their boot time. `lags_s`: how much later than the quickest message [s]."""
    if reboots:
        return Finding(
            "clock",
            "note",
            f"boot time went back {reboots} ×: the vehicle has rebooted",
            "is the power good, also on USB? `run` continues with a new session",
        )
    if not lags_s:
        return Finding("clock", "note", "no boot time came", "see the lines above")
    late = sorted(lags_s)[int(0.95 * (len(lags_s) - 1))]
    found = f"messages come up to {1e3 * max(lags_s):.0f} ms later than the quickest, 95 % within {1e3 * late:.0f} ms"
    return noted(
        "clock",
        found,
        "the link or the machine is overloaded: --stream-rate 10, a higher baud",
        wrong=late > _LATE_S,
    )


def _lla(place: tuple[float, float, float]) -> str:
    return "{:.7f}, {:.7f}, {:.1f} m AMSL".format(*place)


def exit_code(findings: Sequence[Finding]) -> int:
    """Return 0 if a run is possible, 3 without a link or heartbeat, 1 without a valid pose or a port for frames."""
    failed = {finding.check for finding in findings if finding.state == "fail"}
    if failed & _NO_LINK:
        return 3
    return 1 if failed else 0


def verdict(findings: Sequence[Finding], command: str) -> Finding:
    """Judge whether a run is possible, and give the command for it."""
    failed = dict.fromkeys(finding.check for finding in findings if finding.state == "fail")
    if not failed:
        return Finding("verdict", "ok", f"it can run: {command}")
    return Finding(
        "verdict",
        "fail",
        f"it cannot run yet, because of: {', '.join(failed)}",
        f"cure the first of them; then: {command}",
    )


_OURS: Final = re.compile(
    r"(?:(?P<pid>\d+) \()?[^,()]*?(?:-m arva_hil|\barva-hil) (?P<command>run|demo|search|replay|vehicle|campaign|-)"
)


def held(check: str, link: str, what: str) -> Finding | None:
    """Return the finding if `what`, an error or a command line, names a running arva-hil command; else None."""
    if (found := _OURS.search(what)) is None:
        return None
    command = "run" if found["command"] == "-" else found["command"]
    process = f" (process {found['pid']})" if found["pid"] else ""
    end = f"Ctrl-C, or kill -INT {found['pid']}" if found["pid"] else "Ctrl-C"
    return Finding(
        check,
        "fail",
        f"{link}: a running arva-hil {command}{process} has it open",
        f"that command reports its own status; to examine this port, end it first ({end})",
    )


def no_port(candidates: Sequence[SerialPort]) -> Finding:
    """Report that no port was named: only the autopilot's link is examined. `candidates`: those that are free."""
    names = ", ".join(port.device for port in candidates[:6])
    there = f"free: {names}" if candidates else "no serial port is free for it"
    return Finding(
        "port",
        "note",
        f"none was named; {there}",
        ", ".join(
            [*[f"--port {port.device}" for port in candidates if port.usb][:1], "--port pty", "or --format tunnel"]
        ),
    )


def frames(traffic: PortTraffic, form: str) -> Finding:
    """Judge whether the port accepts frames."""
    if traffic.lost:
        return Finding("frames", "fail", traffic.lost, "plug it in again, or start the program at the other end")
    found = f"{traffic.taken} of {traffic.taken + traffic.dropped} {form} frames were accepted, all with no signal"
    if not traffic.taken:
        return Finding(
            "frames",
            "fail",
            found,
            {
                "mavlink": "there is no vehicle to send frames to, see above",
                "tcpin": "start the consumer: no client is connected; `run` waits for it",
                "udpin": "the consumer must send a datagram first; or give its address: --port udpout:HOST:PORT",
                "serial": "the other end does not read, or does not set CTS: is the consumer running?",
            }.get(traffic.kind, "start the consumer: no program reads; `run` waits for it"),
        )
    return noted("frames", found, "the consumer started late, or is too slow", wrong=traffic.dropped > 0)


def reader(traffic: PortTraffic) -> Finding | None:
    """Judge whether a program reads; None if no frame was accepted, which `frames` reports."""
    if traffic.refused:
        return Finding("reader", "fail", "none: no program listens there", "start the consumer, or correct --port")
    if not traffic.taken or traffic.lost:
        return None
    if traffic.answered:
        return Finding("reader", "ok", f"{traffic.answered} bytes came back")
    who = ", ".join(traffic.seen)
    if traffic.kind == "pty":
        if who and traffic.unread:
            return Finding("reader", "note", f"{who} has it open and left {traffic.unread} bytes unread", "let it read")
        if who or not traffic.unread:
            return Finding("reader", "ok", f"{who or 'a program'} reads it")
        return Finding(
            "reader", "note", "no program has it open", f"arva-hil listen {traffic.name}, or start the consumer"
        )
    if traffic.kind in ("tcp", "tcpin"):
        return Finding("reader", "ok", "connected")
    if traffic.kind == "udpin":
        return Finding("reader", "ok", "a datagram came from there")
    if who:
        return Finding("reader", "ok", f"{who} has the other end")
    return Finding(
        "reader",
        "note",
        "unknown",
        {
            "mavlink": "a Lua script or a companion computer must read them; PX4 logs them, see firmware_proto/px4",
            "udpout": "UDP has no acknowledgement; run at the other end: arva-hil listen udpin:0.0.0.0:PORT",
        }.get(
            traffic.kind,
            "a serial line has no acknowledgement; ArduPilot: SERIALn_PROTOCOL 28 and SCR_ENABLE 1 for the Lua driver, "
            "SERIALn_BAUD 115; PX4: arva_receiver status; elsewhere arva-hil listen",
        ),
    )
