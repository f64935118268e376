#!/bin/sh
# random_over_lcm.sh PORTMETD RANDOM_PAIRS CONFIGS SCENES PAIRS: SCENES runs of PAIRS double pendula with
# random weights over LCM, in a private network; every set with each of three integrators. Each run
# must go all the way and record nothing but finite numbers, and no step may violate a law. A run may
# end before a step that discrete_gradient cannot solve, which it tells.
set -u
. "$(dirname "$0")/../support/private_network.sh"
portmetd=$1 random_pairs=$2 configs=$3 scenes=$4 pairs=$5
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
: >"$folder/worst"
failures=0 unsolved=0

fail() {
    failures=$((failures + 1))
    echo "FAILED: $*"
    sed 's/^/    /' "$folder/out" "$folder/err"
}

# one FIRST METHOD
one() {
    "$random_pairs" make "$folder" "$configs" "$1" "$pairs" "$2" || exit 1
    "$portmetd" run "$folder/scene.yaml" --record "$folder/run.h5" >"$folder/out" 2>"$folder/err"
    code=$?
    violations=$(sed -n 's/.*steps in violation: \([0-9]*\);.*/\1/p' "$folder/out")
    [ "${violations:-1}" -eq 0 ] || fail "sets from $1, $2: a law is violated"
    if [ "$2" = discrete_gradient ] && [ $code -eq 9 ] && grep -q "the iteration does not converge" "$folder/err"; then
        unsolved=$((unsolved + 1))
        "$random_pairs" check_begun "$folder" "$folder/run.h5" 2>"$folder/err" || fail "sets from $1, $2"
        return
    fi
    [ $code -eq 0 ] || { fail "sets $1 to $(($1 + pairs - 1)), $2: exit code $code"; return; }
    "$random_pairs" check "$folder" "$folder/run.h5" 2>"$folder/err" || fail "sets from $1, $2"
    awk '/^Worst residual/ { worst = 1 }
        worst && $2 != "of" && ($1 == "energy" || $1 == "entropy") { print $1, $2 }' "$folder/out" >>"$folder/worst"
}

scene=0
while [ $scene -lt "$scenes" ]; do
    for method in rk4 rk4_balanced discrete_gradient; do
        one $((scene * pairs)) $method
    done
    scene=$((scene + 1))
done
echo "$((scenes * pairs)) sets of random weights over LCM: $failures of $((3 * scenes)) runs failed, and $unsolved ended before a step that cannot be solved; worst residuals:"
sort -g -k 2 "$folder/worst" | awk '$1 == "energy" { high = $2 } $1 == "entropy" && !low++ { print }
    END { print "energy", high }'
[ $failures -eq 0 ]
