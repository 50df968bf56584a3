"""Options of the commands that read files: each function adds those of one command."""

from __future__ import annotations

from arva_hil.cli.arguments import shared
from arva_hil.cli.options import CommandParser, kind, number, option, whole
from arva_hil.config.ranges import LARGEST_SEED
from arva_hil.registry import EXPORTS


def decode(parser: CommandParser) -> None:
    """Decode the bytes of a record of `arva-hil record` once more, into another folder.

    For another format, another vehicle in the same packets, or places that were surveyed later.
    """
    parser.add_argument("run", metavar="RECORD", help="folder of a record of `arva-hil record`")
    parser.options(
        option("--out DIR", "folder to make", environment=False),
        shared.format_option(default="binary"),
        shared.SURVEYED,
        *shared.TARGET,
        shared.MAX_AGE,
    )


def compare(parser: CommandParser) -> None:
    """Compare the readings of a record with those of the emulator on the same flight, or of another record.

    With --scenario the emulator computes what its receiver reads at the recorded poses. Two records of one flight are
    paired by the autopilot's clock, those of two flights by common places. Prints bias and scatter of d and δ by range,
    zone, angle and time.
    """
    parser.add_argument("run", metavar="RECORD", help="folder of a record")
    parser.add_argument("other", nargs="?", metavar="RECORD2", help="another record")
    parser.options(
        option("--scenario FILE", "scenario (YAML) of the emulator, or builtin:NAME"),
        option("--seed N", "seed of the emulator's noise", whole(0, LARGEST_SEED)),
        option("--out FILE", "picture to write, .png, .svg or .pdf; needs matplotlib"),
        option("--json", "print a JSON object for each transmitter"),
    )


def fit(parser: CommandParser) -> None:
    """Estimate a receiver's profile from records of flights around a transmitter, each value with its 95 % interval.

    The profile has display law, noise and mount. Transmitters and latency are printed, and go into --scenario-out.
    Outliers count little. It names values that the flights do not determine, and the next pass to fly. If the model
    does not fit, the command says why, and exits with 1. Needs scipy: pip install 'arva-hil[fit]'.
    """
    parser.add_argument("records", nargs="+", metavar="RECORD", help="folder of a record")
    parser.options(
        option(
            "--model NAME",
            "receiver model: paper, pulsed, rssi; default paper",
            environment=False,
            default="paper",
            choices=("paper", "pulsed", "rssi"),
        ),
        option("--out PROFILE.yaml", "profile to write; - is stdout", environment=False),
        option("--scenario-out FILE", "also write a scenario with the transmitters", environment=False),
        option("--gps-sigma M", "standard deviation of the reported position on each axis", number(0, 20), 1.5),
        option("--gps-tau S", "correlation time of its error", number(1, 10_000, " of s"), 60.0),
        option("--json", "print a JSON object"),
    )


def report(parser: CommandParser) -> None:
    """Write a report of a record: one HTML page that needs no other file, and can be sent by mail.

    RUN is a folder that --record has written. The page shows two records side by side, and all records of a folder
    of records. Its pictures need matplotlib: pip install 'arva-hil[plots]'.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record, or a folder with records in it")
    parser.add_argument("other", nargs="?", metavar="RUN2", help="another record, to compare")
    parser.options(option("--out FILE", "the page; default: report.html in RUN; - is stdout"))


def plot(parser: CommandParser) -> None:
    """Draw a record or a campaign.

    RUN is a folder that --record has written: track over flux lines, d against the true range, timeline, lateness,
    rates of the streams. Or it is the folder of a campaign's results: success, time, error. Needs matplotlib: pip
    install 'arva-hil[plots]'.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record or of a campaign's results")
    parser.options(
        option(
            "--out DIR|FILE",
            "folder for one file per picture, or a file name that ends with .png, .svg or .pdf for one sheet; "
            "default: the folder RUN/plots",
        ),
        option(
            "--format",
            "format of the pictures in a folder; default png",
            environment=False,
            dest="picture_format",
            choices=("png", "svg", "pdf"),
        ),
        option(
            "--paper",
            "pictures for a paper: PDF, 3.5 inches wide, 8 points, embedded TrueType fonts, no titles",
            environment=False,
        ),
        option(
            "--size INCHES",
            "width of a picture, e.g. 7.16 for both columns",
            number(1, 20, " of inches"),
            environment=False,
        ),
        option("--dpi N", "resolution of PNG", whole(50, 1200), environment=False),
        option("--latex", "of a campaign also the table, table.tex, for LaTeX with booktabs", environment=False),
    )


def export(parser: CommandParser) -> None:
    """Write a record for maps, spreadsheets and other programs.

    RUN is a folder that --record has written. The place found is a point, with the ellipse of 95 % probability.
    """
    parser.add_argument("run", metavar="RUN", help="folder of a record")
    parser.options(
        option(
            "--format NAME",
            f"{', '.join(EXPORTS)}; default: the ending of FILE",
            kind(EXPORTS),
            environment=False,
            dest="export_format",
        ),
        option("--out FILE", "file to write, which replaces an older one; - is stdout"),
    )


def view(parser: CommandParser) -> None:
    """Open a record as a page in a browser: the same page as --web, with a slider for the time.

    RUN is a folder that --record has written. A LOG.tlog is replayed first, through the scenario.
    """
    parser.add_argument("record_or_log", metavar="RUN|LOG", help="folder of a record, or MAVLink telemetry log")
    parser.options(
        *shared.web_options(default="on"),
        option("--scenario FILE", "scenario for a log (YAML), or builtin:NAME"),
        option(
            "--out FILE",
            "instead write one HTML file that plays the record without arva-hil and without a network, and end; at "
            "most 40,000 readings and 400 states of the search",
        ),
        shared.DURATION,
    )


def check(parser: CommandParser) -> None:
    """Validate scenario files, plans of campaigns and profiles.

    Prints every mistake with line and column, or a summary.
    """
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenario, plan of a campaign or profile (YAML)")
    parser.options(
        option(
            "--schema",
            "print the JSON Schema of these files for editors instead; default: scenario",
            environment=False,
            const="scenario",
            choices=("scenario", "campaign", "receiver", "transmitter"),
        )
    )


def scenarios(parser: CommandParser) -> None:
    """List the built-in scenarios and campaign plans. Use one with --scenario builtin:NAME."""
    parser.options(option("--json", "print a JSON object for each file"))


def completion(parser: CommandParser) -> None:
    """Print a script that completes commands, options and file names in a shell.

    bash, in ~/.bashrc:
      eval "$(arva-hil completion bash)"
    zsh, with ~/.zfunc in $fpath before compinit:
      arva-hil completion zsh > ~/.zfunc/_arva-hil
    fish:
      arva-hil completion fish > ~/.config/fish/completions/arva-hil.fish
    """
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="bash, zsh or fish")
