"""Write a report of a record: one page of HTML that needs nothing else, and opens from a mail.

RUN is a folder that --record has written. Two of them are shown side by side; of a folder with records in it all are.
Its pictures need matplotlib: pip install 'arva-hil[plots]'.
"""

from __future__ import annotations

from arva_hil.cli import options as opt


def add_options(parser: opt.CommandParser) -> None:
    parser.add_argument("run", metavar="RUN", help="folder of a record, or a folder with records in it")
    parser.add_argument("other", nargs="?", metavar="RUN2", help="another record, to compare")
    parser.option("--out", metavar="FILE", help="the page; default: report.html in RUN; - is stdout")
