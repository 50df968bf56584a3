"""The messages, and their streams."""

from __future__ import annotations

from functools import partial

from tools.vectors.frames import Wire, number, seal, sentence
from tools.vectors.streams import Stream

ABOUT = [
    "messages: encode gives `hex`, and `line` where there is one; decoding gives the message back. `type`: command,",
    "answer, vector or level. The codes of commands are in PROTOCOL.md; null is no id, carrier, level or age.",
    "message_streams: as streams, of a fresh decoder of all four kinds of messages; frames are dropped bytes there.",
]
NAMES = ("identify", "mark", "unmark", "select", "restart", "channels", "scan", "search")
RESULTS = ("done", "refused", "unknown", "busy")


def masked(kind: int, body: bytes, mask: int | None = None) -> bytes:
    """Return a message; by default the mask is the lowest with which no byte is A4."""
    plain = bytes([kind]) + body
    if mask is None:
        mask = 0
        while 0xA4 in [byte ^ mask for byte in plain]:
            mask += 1
    return seal(bytes([2, len(plain) + 1, mask]) + bytes(byte ^ mask for byte in plain))


def code(name: str) -> int:
    return NAMES.index(name) + 1 if name in NAMES else int(name.split("-")[1])


def command(number: int, name: str, *values: int) -> Wire:
    return {"type": "command", "number": number, "command": name, "values": list(values)}


def answer(number: int, name: str, result: str, *values: int, text: str = "") -> Wire:
    return {**command(number, name, *values), "type": "answer", "result": result, "text": text}


def vector(id: int | None, x: int, y: int, z: int, exponent: int = 0, zone: int = 1, marked: bool = False,
           period: int = 10000, carrier: int | None = 0, age_ms: int | None = 100) -> Wire:  # fmt: skip
    """x, y and z are mantissas."""
    who = {"id": id, "zone": zone, "marked": marked}
    amplitudes = {"x": x * 2**exponent, "y": y * 2**exponent, "z": z * 2**exponent}
    return who | amplitudes | {"period": period, "carrier": carrier, "age_ms": age_ms, "exponent": exponent}


def level(id: int | None, level: int | None, zone: int = 2, marked: bool = False, age_ms: int | None = 100) -> Wire:
    return {"id": id, "zone": zone, "marked": marked, "level": level, "age_ms": age_ms}


def measured(type: str, sequence: int, status: int, time_ms: int, *channels: Wire) -> Wire:
    return {"type": type, "sequence": sequence, "status": status, "time_ms": time_ms, "channels": list(channels)}


def body(m: Wire) -> tuple[int, bytes]:
    if m["type"] in ("command", "answer"):
        values = b"".join(number(value, 4) for value in m["values"])
        head = bytes([m["number"], code(m["command"])])
        if m["type"] == "command":
            return 16, head + values
        return 17, head + bytes([RESULTS.index(m["result"]), len(m["values"])]) + values + m["text"].encode()
    out = bytes([m["sequence"], m["status"], len(m["channels"])]) + number(m["time_ms"], 4, signed=False)
    for c in m["channels"]:
        out += bytes([255 if c["id"] is None else c["id"], c["zone"] + 128 * c["marked"]])
        age = number(65535 if c["age_ms"] is None else c["age_ms"], 2, signed=False)
        if m["type"] == "level":
            out += number(-0x8000 if c["level"] is None else c["level"], 2) + age
            continue
        out += bytes([c["exponent"]]) + b"".join(number(c[axis] >> c["exponent"], 2) for axis in "xyz")
        out += number(c["period"], 2, signed=False)
        out += number(-0x8000 if c["carrier"] is None else c["carrier"], 2) + age
    return (1 if m["type"] == "vector" else 2), out


def spoken(m: Wire) -> str:
    """Return a command or an answer as a line."""
    answered = [m["result"], m["text"]] if m["type"] == "answer" else []
    return sentence("PARVC" if m["type"] == "command" else "PARVR", m["number"], m["command"], *answered, *m["values"])


EMPTY = vector(None, 0, 0, 0, zone=0, period=0, carrier=None, age_ms=None)
HIGH = vector(254, 0x7FFF, -0x7FFF, 0x7FFF, 16, 2, True, 65535, 0x7FFF, 65534)
MESSAGES: dict[str, Wire] = {f"do_{name}": command(k, name) for k, name in enumerate(NAMES, 1)}
MESSAGES |= {
    "do_mark_3": command(7, "mark", 3),
    "do_unknown": command(200, "command-99", 1, -1, 2**31 - 1, -(2**31)),
    "do_0": command(0, "command-0"),
    "do_255": command(255, "command-255", 0),
    "do_masked": command(0xA4, "scan"),
    "do_masked_twice": command(0xA4, "scan", 0xA5),
    "do_sync_inside": command(1, "mark", int.from_bytes(b"\xa4\x57\x01\x63", "little", signed=True)),
    "done": answer(7, "mark", "done"),
    "refused": answer(8, "mark", "refused"),
    "unknown": answer(200, "command-99", "unknown"),
    "busy": answer(9, "scan", "busy"),
    "identity": answer(1, "identify", "done", 4, text="paper 1.0 binary"),
    "longest": answer(255, "identify", "done", -1, -2, -3, -(2**31), text="~" * 32),
    "vector_1": measured("vector", 1, 1, 12345, vector(1, -12300, 4, 77, 1, 1, False, 10130, -125, 240)),
    "vector_empty": measured("vector", 2, 1, 0, EMPTY),
    "vector_high": measured("vector", 255, 255, 2**32 - 1, HIGH),
    "vector_low": measured("vector", 0, 0, 0, vector(0, -0x8000, -1, 0, 16, 0, False, 0, -0x7FFF, 0)),
    "vector_zone_127": measured("vector", 3, 1, 5, vector(5, 1, 1, 1, 0, 127, True)),
    "vector_masked": measured("vector", 0xA4, 1, 0x5701A4, vector(0xA4, 0x57A4, 0x0901, 0)),
    "level_1": measured("level", 1, 1, 12345, level(1, -4012)),
    "level_empty": measured("level", 2, 1, 0, level(None, None, 0, age_ms=None)),
    "level_high": measured("level", 255, 255, 2**32 - 1, level(254, 0x7FFF, 2, True, 65534)),
}
for n in range(1, 17):
    MESSAGES[f"vector_{n}_channels"] = measured(
        "vector", 100 + n, 1, n, *(vector(k, k, -k, 3 * k, k % 17, k % 3, k % 2 == 1) for k in range(n))
    )
    MESSAGES[f"level_{n}_channels"] = measured("level", 100 + n, 1, n, *(level(k, -k, k % 3) for k in range(n)))
BYTES = {name: masked(*body(m)) for name, m in MESSAGES.items()}


def streams(frame: bytes) -> list[Wire]:
    """`frame`: a good frame of version 1."""
    mark, done, long = BYTES["do_mark_3"], BYTES["done"], BYTES["vector_16_channels"]
    makes_no_sense = [
        masked(17, bytes([7, 1, 4, 0])),  # a result that there is not
        masked(17, bytes([7, 1, 0, 5]) + bytes(20)),  # five values
        masked(17, bytes([7, 1, 0, 2]) + bytes(4)),  # two values in the room of one
        *(masked(17, bytes([7, 1, 0, 0]) + bytes([letter])) for letter in b"\x1f$*,\x7f\xff"),
        masked(17, bytes([7, 1, 0, 0]) + b"x" * 33),
        masked(1, bytes([1, 1, 1, 0, 0, 0, 0, 1, 1, 17]) + bytes(12)),  # exponent 17
        masked(1, bytes([1, 1, 2, 0, 0, 0, 0]) + bytes(15)),  # two channels in the room of one
        masked(2, bytes([1, 1, 2, 0, 0, 0, 0]) + bytes(6)),
    ]
    wrong_sizes = [masked(kind, bytes(size)) for kind in (1, 2, 16) for size in (0, 1, 3, 5, 8, 20, 23)]
    other_kinds = [masked(kind, bytes([1, 2, 3, 4])) for kind in range(256) if kind not in (1, 2, 16, 17)]
    head = b"\xa4\x57\x02\xf9\x00\x01"  # of a message of 16 vectors
    stream = partial(Stream, kind="messages", units=BYTES)
    return [
        stream("messages_glued", "without a byte between")
        .step(0, mark + done + long, "do_mark_3", "done", "vector_16_channels")
        .end(),
        stream("messages_between_frames", "frames are bytes in no message")
        .step(0, frame + done + frame + mark + frame, "done", "do_mark_3")
        .end(),
        stream("half_a_command", "it is dropped after 100 ms")
        .step(0, mark[:8])
        .step(0.099)
        .step(0.101, mark[8:])
        .step(1, mark, "do_mark_3")
        .end(),
        stream("cut_in_time", "99 ms for all of it is enough")
        .step(0, mark[:3])
        .step(0.05, mark[3:9])
        .step(0.099, mark[9:], "do_mark_3")
        .end(),
        stream("command_behind_half_a_command", "the false one is refused when it has its size")
        .step(0, mark[:9] + mark, "do_mark_3")
        .end(bad_crc=1),
        stream("long_head", "a false head of a long message hides what is behind it for 100 ms")
        .step(0, head + done)
        .step(0.099)
        .step(0.101, b"", "done")
        .end(),
        stream("wrong_crc", "the last byte is another")
        .step(0, mark[:-1] + bytes([mark[-1] ^ 1]) + done, "done")
        .end(bad_crc=1),
        stream("no_sense", "right CRCs, bodies that make no sense")
        .step(0, b"".join(makes_no_sense) + done, "done")
        .end(),
        stream("wrong_sizes", "sizes that their kind cannot have").step(0, b"".join(wrong_sizes) + done, "done").end(),
        stream("other_kinds", "kinds that there are not").step(0, b"".join(other_kinds) + done, "done").end(),
        stream("other_masks", "a decoder takes every mask")
        .step(0, b"".join(masked(16, bytes([7, 2, 3, 0, 0, 0]), mask) for mask in range(256)), *["do_mark_3"] * 256)
        .end(),
        stream("other_versions", "not messages")
        .step(0, b"".join(b"\xa4\x57" + bytes([k]) + mark[3:] for k in range(256) if k != 2) + done, "done")
        .end(),
        stream("syncs", "nothing but sync bytes")
        .step(0, b"\xa4" * 300 + b"\x57" * 300 + b"\xa4\x57" * 150 + done, "done")
        .end(),
        stream(
            "no_sync_behind_a_message",
            "a message whose first byte is another, right behind a good one in a false candidate",
        )
        .step(0, b"\xa4\x57\x02\x35\x00\x11" + mark + b"\xa0" + done[1:] + bytes(40), "do_mark_3")
        .end(bad_crc=1),
        stream("not_whole", "the end is awaited").step(0, done + mark[:5], "done").end(awaited=5),
    ]


def parts(frame: bytes) -> dict[str, list[Wire]]:
    """Return the part of vectors.json about messages."""
    messages = []
    for name, m in MESSAGES.items():
        channels = [{key: value for key, value in c.items() if key != "exponent"} for c in m.get("channels", ())]
        said = {"name": name, "hex": BYTES[name].hex(), **m} | ({"channels": channels} if channels else {})
        if m["type"] in ("command", "answer") and len(spoken(m)) <= 82:
            said["line"] = spoken(m)
        messages.append(said)
    return {"messages": messages, "message_streams": streams(frame)}
