#!/bin/sh
# test_install.sh BUILD: what `cmake --install` puts into a prefix works from there, without the source.
set -u
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
prefix=$folder/prefix
failures=0

fail() {
    failures=$((failures + 1))
    echo "FAILED: $*"
}

cmake --install "$1" --prefix "$prefix" >"$folder/install.log" 2>&1 || {
    cat "$folder/install.log"
    fail "cmake --install"
}
share=$prefix/share/portmet
for file in bin/portmetd bin/portmet-train share/man/man1/portmetd.1 share/man/man1/portmet-train.1 \
    share/portmet/lcmtypes/portmet.lcm share/portmet/daemon/spy.sh share/portmet/daemon/loopback.sh \
    share/portmet/daemon/setup.sh share/portmet/configs/double_pendulum.yaml; do
    [ -s "$prefix/$file" ] || fail "$file is not installed"
done

cd "$folder" || exit 1
"$prefix/bin/portmetd" run "$share/configs/double_pendulum.yaml" --in-process --steps 3 >"$folder/run.out" 2>&1 ||
    fail "portmetd does not run an installed scene: $(cat "$folder/run.out")"
grep -q "steps in violation: 0;" "$folder/run.out" || fail "portmetd does not show its tables"
"$prefix/bin/portmet-train" truth "$share/configs/truth/double_pendulum.yaml" --trajectories 0:1 \
    -o "$folder/truth.h5" >"$folder/truth.out" 2>&1 || fail "portmet-train does not read an installed truth file"
found=$(PKG_CONFIG_PATH=$prefix/share/pkgconfig pkg-config --variable=lcmtypes portmet)
[ "$(realpath "$found")" = "$(realpath "$share/lcmtypes")" ] || fail "pkg-config names $found"
if [ "$(id -u)" -eq 0 ] && unshare -n true 2>/dev/null; then
    unshare -n sh "$share/daemon/loopback.sh" "$prefix/bin/portmetd" run "$share/configs/double_pendulum.yaml" \
        --steps 3 --quiet >"$folder/lcm.out" 2>&1 || fail "the installed program does not run over LCM: $(cat "$folder/lcm.out")"
fi
sh "$share/daemon/spy.sh" --help | grep -q usage || fail "the installed spy.sh does not start"

[ $failures -eq 0 ] && echo "all well"
exit $((failures > 0))
