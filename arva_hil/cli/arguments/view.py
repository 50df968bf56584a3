"""Look at a record on a page in a browser: the same page as --web, with a slider for the time.

RUN is a folder that --record has written. A LOG.tlog is replayed first, through the scenario.
"""

from __future__ import annotations

from arva_hil.cli import options as opt
from arva_hil.cli.web_option import page_address
from arva_hil.observers.web.address import Address


def add_options(parser: opt.CommandParser) -> None:
    parser.add_argument("record_or_log", metavar="RUN|LOG", help="folder of a record, or MAVLink telemetry log")
    parser.option(
        "--web",
        type=page_address,
        default=Address(),
        metavar="HOST:PORT",
        help="where the page is: HOST, PORT or HOST:PORT; if the port is taken, the next free one; "
        f"default {Address()}",
    )
    parser.option("--scenario", metavar="FILE", help="of a log: scenario (YAML), or builtin:NAME")
    opt.add_duration(parser)
