#!/usr/bin/env bash
# Test a program that reads a receiver, from the shell: driver_test.sh PROGRAM… (it gets the port's name)
set -eu
coproc BENCH { arva-hil serve --port pty; }
read -r hello <&"${BENCH[0]}"
port=$(sed 's/.*"port": "\([^"]*\)".*/\1/' <<<"$hello")
control=$(sed 's/.*127\.0\.0\.1:\([0-9]*\)".*/\1/' <<<"$hello")
exec 3<>"/dev/tcp/127.0.0.1/$control"

ask() {
    echo "$1" >&3
    read -r answer <&3
    case $answer in '{"ok": true'*) ;; *) echo "$1: $answer" >&2 && exit 1 ;; esac
}

ask '{"do": "place", "north": 15, "east": 5, "down": -2}'
ask '{"do": "advance", "seconds": 2}'
"$@" "$port"
ask '{"do": "stop"}'
