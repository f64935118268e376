#!/bin/sh
# test_export.sh BUILD: scenes exported as C compile without a warning, need nothing but libm, and take
# the same steps as libportmet, bit by bit. What cannot be exported is refused. Runs in the root.
. "$(dirname "$0")/scenes.sh"

# same SCENE STEPS: the exported scene has the bits of the scene.
same() {
    name=$(sed -nE 's/^scene: *([A-Za-z0-9_]+).*/\1/p' "$1")
    "$portmetd" export "$1" --c "$folder" --quiet || fail "$1 is not exported"
    cc -std=c99 -Wall -Wextra -Werror -O1 -c -o "$folder/$name.o" "$folder/$name.c" || fail "$name does not compile"
    if command -v clang >/dev/null; then
        clang -std=c99 -Wall -Wextra -Werror -fsyntax-only "$folder/$name.c" || fail "$name: clang warns"
    fi
    foreign=$(nm -u "$folder/$name.o" | awk '$2 !~ /^(log|sqrt|sin|cos|sincos|memset|memcpy|_GLOBAL_OFFSET_TABLE_|__stack_chk_fail)$/')
    [ -z "$foreign" ] || fail "$name needs $foreign"
    writable=$(nm "$folder/$name.o" | grep ' [BbDd] ')
    [ -z "$writable" ] || fail "$name has state of its own: $writable"
    cc -std=c99 -Wall -Wextra -Werror -O1 -DNAME="$name" -include "$folder/$name.h" \
        -I"$here/../../daemon/library" -o "$folder/$name" "$here/same_bits.c" "$folder/$name.o" \
        -L"$build/daemon/library" -lportmet -lm -Wl,-rpath,"$build/daemon/library" || fail "$name: no test"
    "$folder/$name" "$1" "$2" || fail "$name: other bits"
}

# refused CODE TEXT SCENE: the export ends with this code, says so, and leaves no file.
refused() {
    rm -rf "$folder/none"
    "$portmetd" export "$3" --c "$folder/none" >"$folder/out" 2>"$folder/err"
    [ $? -eq "$1" ] || fail "$3: expected exit code $1"
    grep -q -- "$2" "$folder/err" || fail "$3: expected \"$2\", found: $(cat "$folder/err")"
    [ -z "$(ls "$folder/none" 2>/dev/null)" ] || fail "$3: left $(ls "$folder/none")"
}

same configs/double_pendulum.yaml 200
same configs/beam.yaml 40
same configs/gas_containers.yaml 50
same configs/driven_lower.yaml 90
same configs/double_pendulum_soft.yaml 20
same configs/double_pendulum_free.yaml 20
same configs/analytic_double_pendulum.yaml 20
same configs/crossed_beams.yaml 3
same tests/support/coenergies.yaml 30
for integrator in euler heun rk6; do
    sed "s/integrator: rk4/integrator: $integrator/; s|weights/|$PWD/configs/weights/|; s|reference/|$PWD/configs/reference/|" \
        configs/gas_containers.yaml >"$folder/gas_$integrator.yaml"
    same "$folder/gas_$integrator.yaml" 10
done
refused 3 "integrator discrete_gradient cannot be exported" configs/bouncing_masses.yaml
wide_scene >"$folder/wide.yaml"
refused 3 "only BLAS" "$folder/wide.yaml"
"$portmetd" export configs/double_pendulum.yaml >/dev/null 2>&1
[ $? -eq 2 ] || fail "an export to nowhere"

# Equal links share their functions: ten pendula take hardly more text than two.
"$portmetd" export configs/chain_10.yaml --c "$folder" --quiet
[ "$(wc -l <"$folder/chain_10.c")" -lt $((2 * $(wc -l <"$folder/double_pendulum.c"))) ] ||
    fail "equal subsystems are written twice"

finish
