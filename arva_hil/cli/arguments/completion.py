"""Print a script that completes commands, options and file names in a shell.

bash:  eval "$(arva-hil completion bash)"                      in ~/.bashrc
zsh:   arva-hil completion zsh > ~/.zfunc/_arva-hil            with ~/.zfunc in $fpath, before compinit
fish:  arva-hil completion fish > ~/.config/fish/completions/arva-hil.fish
"""

from __future__ import annotations

from arva_hil.cli.options import CommandParser

SHELLS = ("bash", "zsh", "fish")


def add_options(parser: CommandParser) -> None:
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help="bash, zsh or fish")
