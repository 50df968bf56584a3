"""Options of the other commands: each function adds those of one command."""

from __future__ import annotations

import re

from arva_hil.cli.options import CommandParser, number, option, whole
from arva_hil.config.ranges import LARGEST_SEED


def campaign(parser: CommandParser) -> None:
    """Fly a plan of many trials, on all cores or a cluster, and compare the strategies.

    Each result is saved in DIR/results.sqlite at once. At the end results.csv and report.html are written too.
    The same command continues a campaign that was stopped.
    """
    parser.add_argument(
        "plan",
        metavar="PLAN.yaml",
        help="plan of the campaign, or a built-in one such as builtin:campaigns/paper: see arva-hil scenarios",
    )
    parser.options(
        option("--out DIR", "folder of the results and the report; default: PLAN-results"),
        option("--jobs N", "number of processes; default: one for each core", whole(1, 1024)),
        option("--scheduler tcp://HOST:PORT", "run on a Dask cluster instead", scheduler),
        option(
            "--shard K/N",
            "fly only part K of N of the plan, every N-th seed; default folder: PLAN-results-K-of-N",
            shard,
        ),
        option("--merge DIR", "fly nothing: copy the results of these folders and write the report", nargs="+"),
        option("--dry-run", "list the trials, without flying or writing"),
        option("--json", "print a JSON object for each trial on stdout"),
    )


def range_test(parser: CommandParser) -> None:
    """Carry the scenario's receiver towards its first transmitter, several times, and print its range.

    In three couplings: coaxial, turned by 90°, and with the dipole upright. Only stable signals count, as in the tests
    of receivers: a single signal from farther away does not. With --out it also writes range-test.txt, .csv and .png
    to a folder.
    """
    parser.options(
        option(
            "--scenario FILE",
            "scenario (YAML), or builtin:NAME, for its receivers and the strength of its first transmitter",
        ),
        option("--seed N", "seed of the first walk", whole(0, LARGEST_SEED)),
        option("--walks N", "walks in each coupling", whole(1, 1000), 10, environment=False),
        option(
            "--height M",
            "height of the receiver above the transmitter",
            number(0, 100, " of m"),
            3.0,
            environment=False,
            dest="range_height",
        ),
        option(
            "--speed M/S", "walking speed", number(0.1, 30, " of m/s"), 1.0, environment=False, dest="walking_speed"
        ),
        option(
            "--stable S",
            "a signal without a gap for this time is stable",
            number(0, 1000, " of s"),
            10.0,
            environment=False,
        ),
        option("--out DIR", "folder for the data sheet and its picture"),
        option("--json", "print the data sheet as a JSON object for each receiver"),
    )


def conform(parser: CommandParser) -> None:
    """Judge your decoder of binary frames by each clause of PROTOCOL.md.

    The command reads bytes on stdin, prints one JSON line for each valid frame and channel, flushes it, and ends when
    its input ends:
    {"seq": 0, "slot": 1, "id": 1, "zone": 1, "d_cm": 1905, "delta_deg": 22}
    """
    parser.add_argument("command", metavar="COMMAND", nargs="*", help="the decoder and its arguments, after --")
    parser.options(
        option("--junit FILE", "write the results as JUnit XML, too"),
        option("--list", "list the clauses, and judge nothing"),
        option("--only CLAUSE", "judge this clause; may be given again", str, action="append"),
        option("--pty", "the command opens the port named in $ARVA_PORT, instead of reading stdin"),
        option("--timeout S", "patience with the command", number(0.5, 600, " of s"), 5.0),
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


def scheduler(text: str) -> str:
    """Convert the address of a Dask scheduler."""
    if not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}", text):
        raise ValueError(f"{text!r}: expected an address such as tcp://192.168.1.5:8786")
    return text


def shard(text: str) -> tuple[int, int]:
    """Convert K/N, with K from 1 to N."""
    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
    k, n = map(int, match.groups()) if match else (0, 0)
    if not 1 <= k <= n:
        raise ValueError(f"{text!r}: expected K/N with K from 1 to N, e.g. 3/100")
    return k, n
