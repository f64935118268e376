# Sourced by scripts of this folder.

# resources PROCESS...: the resident memory in kB, the threads and the open files of these processes together.
resources() {
    for process in "$@"; do
        awk '/^VmRSS/ {m = $2} /^Threads/ {t = $2} END {print m, t}' "/proc/$process/status"
        ls "/proc/$process/fd" | wc -l
    done | awk 'NF == 2 {m += $1; t += $2} NF == 1 {f += $1} END {print m " kB, " t " threads, " f " files"}'
}

# flat BEFORE AFTER: two lines of `resources` differ by less than 500 kB of memory, and in nothing else.
flat() {
    echo "$1 $2" | awk '{exit !($7 <= $1 + 500 && $9 == $3 && $11 == $5)}' || { echo "something has grown"; return 1; }
}
