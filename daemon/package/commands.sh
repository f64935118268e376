#!/bin/sh
# commands.sh PROGRAM ABOUT TAIL: prints the manual page of PROGRAM, from what it and its commands print as help.
set -eu
help=$("$1" --help)
{
    echo "$help"
    for command in $(echo "$help" | awk '/^[A-Z]/ { on = /^Commands:/ } on && /^  / { print $1 }'); do
        echo
        "$1" "$command" --help
    done
} | awk -v name="$(basename "$1")" -v about="$2" -v tail="$3" -f "$(dirname "$0")/commands.awk"
