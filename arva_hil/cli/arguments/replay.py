"""Replay a recorded flight through the emulator. The same log, scenario and seed give the same bytes."""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.cli.live_options import add_live
from arva_hil.cli.web_option import add_web


def add_options(parser: opt.CommandParser) -> None:
    parser.add_argument("log", metavar="LOG.tlog", help="MAVLink telemetry log")
    parser.option(
        "--port",
        type=opt.address,
        metavar="URL",
        help="send the frames there, at the speed of the log unless --speed is given",
    )
    parser.option("--out", metavar="FILE", help="write the frames to a file; - is stdout")
    parser.option(
        "--speed", type=opt.speed, metavar="N|max", help="multiple of real time; default 1 with --port, else max"
    )
    opt.add_scenario(parser)
    opt.add_target(parser)
    opt.add_max_age(parser)
    add_live(parser)
    opt.add_common(parser)
    add_web(parser)
