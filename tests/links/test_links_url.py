"""Every spelling of a connection string, and every refusal."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.links import Address, AddressError, parse
from arva_hil.links.url import excludes, place
from tests.every import every

SPELLINGS = {
    "/dev/ttyACM0": Address("serial", path="/dev/ttyACM0"),
    "/dev/ttyACM0,57600": Address("serial", path="/dev/ttyACM0", baud=57600),
    "serial:///dev/ttyACM0:57600": Address("serial", path="/dev/ttyACM0", baud=57600),
    "serial:///dev/ttyACM0,57600": Address("serial", path="/dev/ttyACM0", baud=57600),
    "serial:/dev/ttyACM0:57600": Address("serial", path="/dev/ttyACM0", baud=57600),
    "serial:/dev/ttyACM0": Address("serial", path="/dev/ttyACM0"),
    "SERIAL:/dev/ttyACM0": Address("serial", path="/dev/ttyACM0"),
    "COM5": Address("serial", path="COM5"),
    "com12": Address("serial", path="com12"),
    "COM5,57600": Address("serial", path="COM5", baud=57600),
    "serial:COM5:57600": Address("serial", path="COM5", baud=57600),
    "serial://COM5": Address("serial", path="COM5"),
    r"\\.\COM12": Address("serial", path=r"\\.\COM12"),
    "/tmp/arva0": Address("serial", path="/tmp/arva0"),
    "./arva0": Address("serial", path="./arva0"),
    "../arva0,9600": Address("serial", path="../arva0", baud=9600),
    "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0": Address(
        "serial", path="/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0"
    ),
    "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0,57600": Address(
        "serial", path="/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0", baud=57600
    ),
    "udpin:127.0.0.1:14550": Address("udpin", "127.0.0.1", 14550),
    "udpin://127.0.0.1:14550": Address("udpin", "127.0.0.1", 14550),
    "udpin://127.0.0.1:14550/": Address("udpin", "127.0.0.1", 14550),
    "udpin:0.0.0.0:14550": Address("udpin", "0.0.0.0", 14550),
    "udpin::14550": Address("udpin", "127.0.0.1", 14550),
    "udpin://:14550": Address("udpin", "127.0.0.1", 14550),
    "udpin:14550": Address("udpin", "127.0.0.1", 14550),
    "udpin:[::1]:14550": Address("udpin", "::1", 14550),
    " udpin:127.0.0.1:14550\n": Address("udpin", "127.0.0.1", 14550),
    "UDPIN:127.0.0.1:1": Address("udpin", "127.0.0.1", 1),
    "udpout:192.168.1.7:65535": Address("udpout", "192.168.1.7", 65535),
    "udpout://drone.local:14550": Address("udpout", "drone.local", 14550),
    "tcp:127.0.0.1:5760": Address("tcp", "127.0.0.1", 5760),
    "tcp://127.0.0.1:5760": Address("tcp", "127.0.0.1", 5760),
    "tcpout:127.0.0.1:5760": Address("tcp", "127.0.0.1", 5760),
    "tcpout://127.0.0.1:5760": Address("tcp", "127.0.0.1", 5760),
    "tcpout://[fe80::1%eth0]:5760": Address("tcp", "fe80::1%eth0", 5760),
    "tcpin:127.0.0.1:5760": Address("tcpin", "127.0.0.1", 5760),
    "tcpin:5760": Address("tcpin", "127.0.0.1", 5760),
    "tcpin://[::]:5760": Address("tcpin", "::", 5760),
    "pty": Address("pty"),
    "pty:/tmp/arva0": Address("pty", path="/tmp/arva0"),
    "pty:///tmp/arva0": Address("pty", path="/tmp/arva0"),
    "pty:arva0": Address("pty", path="arva0"),
    "file.tlog": Address("tlog", path="file.tlog"),
    "/logs/A.TLOG": Address("tlog", path="/logs/A.TLOG"),
    r"C:\logs\a.tlog": Address("tlog", path=r"C:\logs\a.tlog"),
    "file:flight.bin": Address("tlog", path="flight.bin"),
    "file:///logs/a.tlog": Address("tlog", path="/logs/a.tlog"),
    "-": Address("stdout"),
    "rfc2217://10.0.0.2:2217": Address("pyserial", path="rfc2217://10.0.0.2:2217"),
    "socket://10.0.0.2:7000": Address("pyserial", path="socket://10.0.0.2:7000"),
    "loop://": Address("pyserial", path="loop://"),
    "spy:///dev/ttyUSB0": Address("pyserial", path="spy:///dev/ttyUSB0"),
    "hwgrep://0403:6001": Address("pyserial", path="hwgrep://0403:6001"),
    "alt:///dev/tty?class=PosixPollSerial": Address("pyserial", path="alt:///dev/tty?class=PosixPollSerial"),
}

ANY_EXAMPLE = "write /dev/ttyACM0,57600, COM5, pty, udpin:127.0.0.1:14550, tcp:127.0.0.1:5760 or log.tlog"
REFUSALS = {
    "127.0.0.1:14550": "could be UDP or TCP: write udpin:127.0.0.1:14550, udpout:127.0.0.1:14550 or "
    "tcp:127.0.0.1:14550",
    "localhost:14550": "could be UDP or TCP: write udpin:localhost:14550, ",
    ":14550": "could be UDP or TCP: write udpin:127.0.0.1:14550, ",
    "[::1]:14550": "could be UDP or TCP: write udpin:[::1]:14550, ",
    "udp:10.0.0.1:1455": "does not say which side listens: write udpin:10.0.0.1:1455 or udpout:10.0.0.1:1455",
    "udp://:14540": "does not say which side listens: write udpin:127.0.0.1:14540 or udpout:127.0.0.1:14540",
    "udp:14551": "does not say which side listens: write udpin:127.0.0.1:14551 ",
    "udp:drone": "does not say which side listens: write udpin:drone:14550 ",
    "udp:": "does not say which side listens: write udpin:127.0.0.1:14550 ",
    "": f"is empty: {ANY_EXAMPLE}",
    "  ": f"is empty: {ANY_EXAMPLE}",
    "autopilot": f"is no connection: {ANY_EXAMPLE}",
    "127.0.0.1": f"is no connection: {ANY_EXAMPLE}",
    "dir/arva0": f"is no connection: {ANY_EXAMPLE}",
    "ttyUSB0,57600": f"is no connection: {ANY_EXAMPLE}",
    "http://127.0.0.1/x": f"starts with 'http', which is not a kind of link: {ANY_EXAMPLE}",
    "upd:127.0.0.1:14550": f"starts with 'upd', which is not a kind of link: {ANY_EXAMPLE}",
    "loop:": f"starts with 'loop', which is not a kind of link: {ANY_EXAMPLE}",
    "udpin:": "has no port: write udpin:127.0.0.1:14550",
    "udpin:10.0.0.1": "has no port: write udpin:10.0.0.1:14550",
    "udpin:10.0.0.1:": "has no port: write udpin:10.0.0.1:14550",
    "tcpout://drone": "has no port: write tcpout:drone:5760",
    "tcp:[::1]": "is not a host and a port: write tcp:127.0.0.1:5760 or tcp:[::1]:5760",
    "tcp:fe80::1": "is not a host and a port: write tcp:127.0.0.1:5760 or tcp:[::1]:5760",
    "tcp:a:5760:b": "is not a host and a port: write tcp:127.0.0.1:5760",
    "tcp:a b:5760": "is not a host and a port: write tcp:127.0.0.1:5760",
    "tcp:[]:5760": "is not a host and a port: write tcp:127.0.0.1:5760",
    "tcp:h:0": "has the port '0', which is not a number 1…65535: write tcp:h:5760",
    "udpin:0": "has the port '0', which is not a number 1…65535: write udpin:127.0.0.1:14550",
    "tcp:h:65536": "has the port '65536', which is not a number 1…65535: write tcp:h:5760",
    "tcp:h:-1": "has the port '-1', which is not",
    "tcp:h:+5": "has the port '+5', which is not",
    "tcp:h:5_0": "has the port '5_0', which is not",
    "tcp:h:٣": "has the port '٣', which is not",
    "udpin:h:mav": "has the port 'mav', which is not",
    "tcp:5760": "has no host: write tcp:127.0.0.1:5760",
    "tcp::5760": "has no host: write tcp:127.0.0.1:5760",
    "udpout:14550": "has no host: write udpout:127.0.0.1:14550",
    "/dev/ttyA0:57600": "has a colon before the baud rate: write /dev/ttyA0,57600 or serial:/dev/ttyA0:57600",
    "COM5:57600": "has a colon before the baud rate: write COM5,57600 or serial:COM5:57600",
    "/dev/ttyACM0,": "has the baud rate '', which is not a number of bit/s: write /dev/ttyACM0,57600",
    "/dev/ttyACM0,fast": "has the baud rate 'fast', which is not a number of bit/s: write /dev/ttyACM0,57600",
    "/dev/ttyACM0,0": "has the baud rate '0', which",
    "/dev/ttyACM0,-9600": "has the baud rate '-9600', which",
    "/dev/ttyACM0,57600,8N1": "has the baud rate '8N1', which",
    "serial:/dev/ttyACM0:10": "has the baud rate '10', which",
    "serial:": "has the device ''",
    "serial:ttyACM0": "has the device 'ttyACM0': write /dev/ttyACM0,57600, serial:/dev/ttyACM0 or COM5",
    "COM5x": "has the device 'COM5x'",
    "/dev/": "has the device '/dev/'",
    "pty:": "has no path: write pty:/tmp/arva0",
    "file://": "has no path: write file:log.tlog",
}


@every("text, address", SPELLINGS.items())
def test_spelling(text: str, address: Address) -> None:
    assert parse(text) == address


@every("address", SPELLINGS.values())
def test_an_address_is_spelled_so_that_it_reads_back(address: Address) -> None:
    assert parse(str(address)) == address


@every("text, found", REFUSALS.items())
def test_refusal(text: str, found: str) -> None:
    with pytest.raises(AddressError) as caught:
        parse(text)
    assert str(caught.value).startswith(f"{text.strip()!r} {found}")
    assert str(caught.value) == f"{caught.value.found}: write {caught.value.cure}"


def test_a_refusal_may_know_no_cure() -> None:
    error = AddressError("'x' is no connection")
    assert (str(error), error.found, error.cure) == ("'x' is no connection", "'x' is no connection", "")


@every("text", [t for t in REFUSALS if t not in ("udp:drone", "tcp:fe80::1")])
def test_every_example_of_a_refusal_is_right(text: str) -> None:
    with pytest.raises(AddressError) as caught:
        parse(text)
    examples = str(caught.value).rpartition(": write ")[2]
    for example in examples.replace(" or ", ", ").split(", "):
        parse(example)


@given(st.text() | st.text(alphabet="udpintcosyr:/,.[]0159%-COM", max_size=25))
def test_nothing_else_than_an_address_error(text: str) -> None:
    try:
        address = parse(text)
    except AddressError:
        return
    assert parse(str(address)) == address


@pytest.mark.parametrize(
    ("one", "other", "does"),
    [
        ("udpin:0.0.0.0:5", "udpin:127.0.0.1:5", True),
        ("udpin:[::]:5", "udpin:0.0.0.0:5", True),
        ("tcpin:[::]:5", "tcpin:[::1]:5", True),
        ("tcpin:[::]:5", "tcpin:0.0.0.0:5", False),  # a server of IPv6 only
        ("udpin:0.0.0.0:5", "udpin:[::1]:5", False),
        ("udpin:0.0.0.0:5", "udpin:127.0.0.1:6", False),
        ("udpin:0.0.0.0:5", "tcpin:127.0.0.1:5", False),
        ("udpin:127.0.0.1:5", "udpin:127.0.0.2:5", False),
    ],
)
def test_who_listens_at_all_addresses_excludes_others_as_the_system_does(one: str, other: str, does: bool) -> None:
    assert excludes(place(one), place(other)) is does
