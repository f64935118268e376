#!/bin/sh
# processes.sh RUN_BENCH_PROCESSES CONFIGS: chains of 1,000, 10,000 and 100,000 links in one process, in two over LCM and
# in two over MPI, in turn; root. Prints the median over the rounds for each process: microseconds for a step by the
# clock, of processor time, and of waiting.
if [ "${PM_PRIVATE_NETWORK:-}" != yes ]; then
    PM_PRIVATE_NETWORK=yes exec unshare -n sh "$0" "$@"
fi
ip link set lo up
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo
bench=$1
configs=$2
rounds=${3:-5}
export OPENBLAS_NUM_THREADS=1
# Open MPI refuses root, and more ranks than cores, unless it is told otherwise.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1

# lines LINKS HOW COMMAND...: what the command prints, each line after the number of links and how they ran.
lines() {
    prefix="$1 $2"
    shift 2
    "$@" | grep 'us/step' | sed "s/^/$prefix /"
}

round=0
while [ $round -lt "$rounds" ]; do
    for links in 1000 10000 100000; do
        steps=$((3000000 / links))
        lines $links one "$bench" "$configs" $links $steps 0
        lines $links LCM "$bench" "$configs" $links $steps 2
        if command -v mpirun >/dev/null; then
            lines $links MPI mpirun -n 3 "$bench" "$configs" $links $steps 2 mpi://
        fi
    done
    round=$((round + 1))
done | awk '
    function median(key, what, n,   i, j, x) {
        for (i = 1; i <= n; i++) value[i] = all[key, what, i]
        for (i = 2; i <= n; i++) for (j = i; j > 1 && value[j] < value[j - 1]; j--) {
            x = value[j]; value[j] = value[j - 1]; value[j - 1] = x
        }
        return value[int((n + 1) / 2)]
    }
    {
        key = sprintf("%8d  %-4s %-12s", $1, $2, $3)
        if (!(key in count)) order[++keys] = key
        n = ++count[key]
        all[key, "clock", n] = $4; all[key, "cpu", n] = $6; all[key, "wait", n] = $9
    }
    END {
        print "   links  how  process        us/step   of CPU  waiting"
        for (k = 1; k <= keys; k++) {
            key = order[k]
            printf "%s %9.0f %8.0f %8.0f\n", key, median(key, "clock", count[key]),
                median(key, "cpu", count[key]), median(key, "wait", count[key])
        }
    }'
