#!/bin/sh
# processes.sh RUN_BENCH_PROCESSES CONFIGS [ROUNDS]: many learned links in one process and in several, in turn; root.
# First chains of 1,000, 10,000 and 100,000 links in one process, in two over LCM and in two over MPI; then chains, grids
# and networks of 10,000 links in two and in eight processes, and in two on hosts of their own, which are network
# namespaces with a virtual cable between them. Prints the median over the rounds for each process: microseconds for a
# step by the clock, of processor time, and of waiting, and the bytes that all processes send for a step over LCM.
. "$(dirname "$0")/../support/private_network.sh"
bench=$1
configs=$2
rounds=${3:-5}
export OPENBLAS_NUM_THREADS=1
# Open MPI refuses root, and more ranks than cores, unless it is told otherwise.
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1
session=1

# received DEVICE: how many bytes this network has received through the device.
received() {
    sed -n "s/^ *$1: *\([0-9]*\).*/\1/p" /proc/net/dev
}

# lines SHAPE LINKS HOW STEPS COMMAND...: what the command prints, each line after the shape, the number of links, how they
# ran, and the bytes that came through the loopback for each step.
lines() {
    prefix="$1 $2 $3"
    steps=$4
    shift 4
    before=$(received lo)
    printed=$("$@" | grep 'us/step')
    bytes=$((($(received lo) - before) / steps))
    echo "$printed" | sed "s/^/$prefix $bytes /"
}

# several SHAPE LINKS STEPS PROCESSES: the same over LCM and over MPI.
several() {
    lines "$1" "$2" "LCM-$4" "$3" "$bench" "$configs" "$1" "$2" "$3" "$4"
    if command -v mpirun >/dev/null; then
        lines "$1" "$2" "MPI-$4" "$3" mpirun -n $(($4 + 1)) "$bench" "$configs" "$1" "$2" "$3" "$4" mpi://
    fi
}

# on HOST COMMAND...: runs the command in the network of the host.
on() {
    network=/proc/$1/ns/net
    shift
    nsenter --net="$network" "$@"
}

# on_hosts SHAPE LINKS STEPS: two processes, one of them and the coordinator on one host, the other one on another.
on_hosts() {
    url="udpm://239.255.76.68:7668?ttl=1"
    session=$((session + 1))
    on "$there" "$bench" "$configs" "$1" "$2" "$3" 2 "$url" $session 1 >"$log.1" &
    one=$!
    on "$here" "$bench" "$configs" "$1" "$2" "$3" 2 "$url" $session 0 >"$log.0" &
    other=$!
    on "$here" "$bench" "$configs" "$1" "$2" "$3" 2 "$url" $session -1
    wait $one $other
    cat "$log.0" "$log.1"
}

# plug HOST DEVICE ADDRESS: sets up the end of the cable in the network of the host.
plug() {
    on "$1" ip addr add "$3" dev "$2" && on "$1" ip link set lo up && on "$1" ip link set "$2" up &&
        on "$1" ip route add 224.0.0.0/4 dev "$2"
}

unshare -n sleep 100000 &
here=$!
unshare -n sleep 100000 &
there=$!
log=$(mktemp)
trap 'kill $here $there; rm -f "$log" "$log.0" "$log.1"' EXIT
for host in $here $there; do
    while [ "$(readlink "/proc/$host/ns/net")" = "$(readlink /proc/$$/ns/net)" ]; do sleep 0.01; done
done
hosts=no
if ip link add cable0 netns $here type veth peer name cable1 netns $there && plug $here cable0 10.0.0.1/24 &&
    plug $there cable1 10.0.0.2/24; then
    hosts=yes
fi

round=0
while [ $round -lt "$rounds" ]; do
    for links in 1000 10000 100000; do
        steps=$((3000000 / links))
        lines chain $links one $steps "$bench" "$configs" chain $links $steps 0
        several chain $links "$steps" 2
    done
    for shape in chain grid network; do
        [ $shape = chain ] || lines $shape 10000 one 300 "$bench" "$configs" $shape 10000 300 0
        [ $shape = chain ] || several $shape 10000 300 2
        several $shape 10000 300 8
    done
    [ $hosts = no ] || lines chain 10000 hosts-2 300 on_hosts chain 10000 300
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
        key = sprintf("%-8s %8d  %-8s %-12s", $1, $2, $3, $5)
        if (!(key in count)) order[++keys] = key
        n = ++count[key]
        all[key, "bytes", n] = $4; all[key, "clock", n] = $6; all[key, "cpu", n] = $8; all[key, "wait", n] = $11
    }
    END {
        print "shape       links  how      process        us/step   of CPU  waiting  bytes/step"
        for (k = 1; k <= keys; k++) {
            key = order[k]
            printf "%s %9.0f %8.0f %8.0f %11.0f\n", key, median(key, "clock", count[key]),
                median(key, "cpu", count[key]), median(key, "wait", count[key]), median(key, "bytes", count[key])
        }
    }'
