#!/bin/sh
# serve.sh PORTMETD BENCH CONFIGS PYTHON [RUNS [REST]]: what clients of `portmetd serve` wait for, in a private network
# (root), with the memory, the threads and the descriptors of the service before and after; and what it takes while
# nothing is asked for REST s.
# `chrt -f 1 sh serve.sh ...` measures what a machine without other work does.
. "$(dirname "$0")/../../support/private_network.sh"
. "$(dirname "$0")/resources.sh"
portmetd=$1
bench=$2
configs=$(realpath "$3")
python=$4
runs=${5:-1000}
rest=${6:-60}
folder=$(mktemp -d)
trap 'kill $service 2>/dev/null; rm -rf "$folder"' EXIT

# processes: the ids of the service and of its nodes.
processes() {
    echo $service $(cat /proc/$service/task/$service/children)
}

# busy: the processor time of all processes so far, in us.
busy() {
    for process in $(processes); do
        cut -d' ' -f1 "/proc/$process/schedstat"
    done | awk '{s += $1 / 1000} END {printf "%d", s}'
}

# serve SCENE OPTION...
serve() {
    "$portmetd" serve "$@" 2>"$folder/err" &
    service=$!
    until "$portmetd" query "$1" 2>/dev/null | grep -q ": idle"; do kill -0 $service || exit 1; sleep 0.2; done
}

serve "$configs/double_pendulum.yaml"
"$bench" "$configs/double_pendulum.yaml" 20 200 100 >/dev/null
echo "double pendulum, before: $(resources $(processes))"
"$bench" "$configs/double_pendulum.yaml" "$runs" 200 100
echo "double pendulum, after $runs runs: $(resources $(processes))"
kill $service
wait $service

sed "s#\(weights: \|file: \)#&$configs/#; s/substeps: 16 .*/substeps: 1/" "$configs/double_pendulum.yaml" >"$folder/short.yaml"
serve "$folder/short.yaml"
echo "double pendulum with 4 exchanges in a step:"
"$bench" "$folder/short.yaml" "$runs" 20 100
kill $service
wait $service

serve "$configs/double_pendulum.yaml" --in-process --compiled
echo "double pendulum in the service's process, with compiled models:"
"$bench" "$configs/double_pendulum.yaml" "$runs" 200 100
PYTHONPATH=$python /usr/bin/python3 - "$runs" <<'SCRIPT'
import sys, time
import portmet
with portmet.Remote("double_pendulum") as scene:
    took = []
    for _ in range(int(sys.argv[1])):
        begun = time.perf_counter()
        scene.step(1)
        took.append(1e6 * (time.perf_counter() - begun))
took.sort()
n = len(took)
print("%-28s least %9.1f   median %9.1f   quartiles %9.1f %9.1f us" %
      ("one step alone, from Python", took[0], took[n // 2], took[n // 4], took[3 * n // 4]))
SCRIPT
kill $service
wait $service

cat >"$folder/idle.yaml" <<'SCENE'
scene: idle
time: {dt: 0.1, steps: 10, integrator: rk4}
models:
  mass: {energy: "|p|^2/2 + |q|^2/2", reversible: {given: [[q, p, 1.0]]}}
  tie: {law: bracket, reversible: {given: [[b.q, a.p, 1.0]]}}
subsystems:
  "mass[1:65]":
    model: mass
    state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1}}
    initial: {q: 1.0, p: 0.0}
ports:
  "tie[1:64]": {law: bracket, between: ["mass[i]", "mass[i+1]"], model: tie, expose: {"mass[i]": p, "mass[i+1]": q}}
SCENE
serve "$folder/idle.yaml"
sleep 2
before=$(busy)
sleep "$rest"
echo "idle, $(processes | wc -w) processes: $((($(busy) - before) / rest)) us of processor time in a second"
"$bench" "$folder/idle.yaml" 1 1 1
kill $service
wait $service
