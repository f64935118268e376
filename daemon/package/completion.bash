# Completion for portmetd, portmet-train and portmet-mesh in bash: subcommands and options as the programs print them,
# and files.
_portmet() {
    local program=${COMP_WORDS[0]} current=${COMP_WORDS[COMP_CWORD]} words
    COMPREPLY=()
    if [ "$program" = portmet-mesh ]; then # it has no subcommands
        words=$("$program" --help 2>/dev/null | sed -nE 's/^ +(-[a-z], )?(--[a-z-]+).*/\2/p')
        mapfile -t COMPREPLY < <(compgen -W "$words --version" -f -- "$current")
    elif [ "$COMP_CWORD" -eq 1 ]; then
        words=$("$program" --help 2>/dev/null | sed -nE 's/^  ([a-z]+) .*/\1/p')
        mapfile -t COMPREPLY < <(compgen -W "$words --help --version" -- "$current")
    elif [[ $current == -* ]]; then
        words=$("$program" "${COMP_WORDS[1]}" --help 2>/dev/null |
            sed -nE 's/^ +(-[a-z], )?(--[a-z-]+).*/\2/p')
        mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
    elif [ "$COMP_CWORD" -eq 2 ] && [ "${COMP_WORDS[1]}" = emit ]; then
        mapfile -t COMPREPLY < <(compgen -W "systemd procman" -- "$current")
    else
        compopt -o filenames 2>/dev/null
        mapfile -t COMPREPLY < <(compgen -f -- "$current")
    fi
}
complete -F _portmet portmetd portmet-train portmet-mesh
