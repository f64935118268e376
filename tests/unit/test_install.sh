#!/bin/sh
# test_install.sh BUILD: what `cmake --install` puts into a prefix works from there, without the source.
. "$(dirname "$0")/../support/setting.sh"
prefix=$folder/prefix
source=$(realpath "$(dirname "$0")/../..")

cmake --install "$1" --prefix "$prefix" >"$folder/install.log" 2>&1 || {
    cat "$folder/install.log"
    fail "cmake --install"
}
share=$prefix/share/portmet
for file in bin/portmetd bin/portmet-train share/man/man1/portmetd.1 share/man/man1/portmet-train.1 \
    share/portmet/lcmtypes/portmet.lcm share/portmet/daemon/spy.sh share/portmet/daemon/loopback.sh \
    share/portmet/daemon/setup.sh share/portmet/configs/double_pendulum.yaml include/portmet.h \
    lib/systemd/system/portmetd@.service lib/systemd/system/portmet-node@.service; do
    [ -s "$prefix/$file" ] || fail "$file is not installed"
done

# Source that others may copy from here says its licence.
find "$prefix" -name '*.h' -o -name '*.c' -o -name '*.py' -o -name '*.sh' -o -name '*.lcm' |
    xargs grep -L "SPDX-License-Identifier: MIT" >"$folder/unlicensed"
[ -s "$folder/unlicensed" ] && fail "no SPDX line: $(cat "$folder/unlicensed")"

# No page that is installed links to what is not.
doc=$prefix/share/doc/portmet
find "$doc" -name '*.md' | while read -r page; do
    grep -oE '\]\([^)# ]+' "$page" | cut -c3- | grep -v '://' | while read -r link; do
        [ -e "$(dirname "$page")/$link" ] || echo "${page#"$doc/"}: $link"
    done
done >"$folder/dead"
[ -s "$folder/dead" ] && fail "dead links of installed pages: $(cat "$folder/dead")"

# The help of each command has examples, whose options the command knows; the manual page is made of them.
for program in portmetd portmet-train; do
    for command in $("$prefix/bin/$program" --help | sed -nE 's/^  ([a-z]+) .*/\1/p'); do
        "$prefix/bin/$program" "$command" --help >"$folder/help"
        sed -n '/^Examples:$/,/^$/p' "$folder/help" >"$folder/examples"
        grep -q "^  $program $command " "$folder/examples" || fail "$program $command --help has no example"
        for option in $(grep -oE ' --?[a-z-]+' "$folder/examples"); do
            grep -qE "^ +(-[a-z], )?$option |^ +$option," "$folder/help" || fail "$program $command: the example's $option"
        done
        tr -d '\\' <"$prefix/share/man/man1/$program.1" | grep -q "^.SS $program $command " || fail "$program.1 lacks $command"
    done
done

for page in "$prefix"/share/man/man1/*.1; do
    for section in ENVIRONMENT FILES BUGS EXAMPLES "SEE ALSO"; do
        grep -qx ".SH $section" "$page" || fail "${page##*/} lacks $section"
    done
done

# The units name the program where the build was configured to install it.
if command -v systemd-analyze >/dev/null; then
    for unit in portmet-node portmetd; do
        sed "s,^ExecStart=[^ ]*,ExecStart=$prefix/bin/portmetd," \
            "$prefix/lib/systemd/system/$unit@.service" >"$folder/$unit@.service"
        systemd-analyze verify --man=no "$folder/$unit@.service" >"$folder/unit.out" 2>&1 ||
            fail "$unit@.service: $(cat "$folder/unit.out")"
    done
fi

cd "$folder" || exit 1
"$prefix/bin/portmetd" run "$share/configs/double_pendulum.yaml" --in-process --steps 3 >"$folder/run.out" 2>&1 ||
    fail "portmetd does not run an installed scene: $(cat "$folder/run.out")"
grep -q "steps in violation: 0;" "$folder/run.out" || fail "portmetd does not show its tables"
"$prefix/bin/portmet-train" truth "$share/configs/truth/double_pendulum.yaml" --trajectories 0:1 \
    -o "$folder/truth.h5" >"$folder/truth.out" 2>&1 || fail "portmet-train does not read an installed truth file"
if /usr/bin/python3 -c 'import h5py' 2>/dev/null; then
    printf 't,x\n0,1\n1,2\n' >"$folder/table.csv"
    "$prefix/bin/portmet-train" import "$folder/table.csv" -o "$folder/table.h5" >"$folder/table.out" 2>&1 ||
        fail "the installed portmet-train does not read tables: $(cat "$folder/table.out")"
fi
pc=$(dirname "$(find "$prefix" -name libportmet.pc)")
[ "$(find "$prefix" -name '*.pc' | wc -l)" -eq 1 ] || fail "another .pc file than libportmet.pc is installed"
found=$(PKG_CONFIG_PATH=$pc pkg-config --variable=lcmtypes libportmet)
[ "$(realpath "$found")" = "$(realpath "$share/lcmtypes")" ] || fail "pkg-config names $found"
if [ "$(id -u)" -eq 0 ] && unshare -n true 2>/dev/null; then
    unshare -n sh "$share/daemon/loopback.sh" "$prefix/bin/portmetd" run "$share/configs/double_pendulum.yaml" \
        --steps 3 --quiet >"$folder/lcm.out" 2>&1 || fail "the installed program does not run over LCM: $(cat "$folder/lcm.out")"
fi

# An example in C, with pkg-config and with CMake.
cp "$source/daemon/examples/example.c" "$folder/example.c"
library=$(dirname "$(find "$prefix" -name libportmet.so)")
flags=
nm -D "$library/libportmet.so" | grep -q __asan_init && flags=-fsanitize=address,undefined
cc $flags -Wall -Wextra -Werror -std=c99 -o "$folder/example" "$folder/example.c" \
    $(PKG_CONFIG_PATH=$pc pkg-config --cflags --libs libportmet) || fail "the example does not compile"
LD_LIBRARY_PATH=$library "$folder/example" "$share/configs/double_pendulum.yaml" >"$folder/example.out" 2>&1 &&
    grep -q "t = 60 s: upper has" "$folder/example.out" || fail "the example: $(cat "$folder/example.out")"
cat >"$folder/CMakeLists.txt" <<END
cmake_minimum_required(VERSION 3.25)
project(example C)
find_package(portmet REQUIRED)
add_executable(example example.c)
target_link_libraries(example portmet::portmet $flags)
END
{ cmake -S "$folder" -B "$folder/cmake" -DCMAKE_PREFIX_PATH="$prefix" && cmake --build "$folder/cmake"; } \
    >"$folder/cmake.out" 2>&1 || fail "find_package: $(cat "$folder/cmake.out")"
foreign=$(nm -D --defined-only "$library/libportmet.so" | awk '$2 != "A" && $3 !~ /^portmet_[a-z_]+@@PORTMET_/')
[ -z "$foreign" ] || fail "the library shows symbols that are not its interface: $foreign"

# The installed Python package finds the installed library and programs.
for python in python3 /usr/bin/python3; do
    [ -z "$flags" ] && "$python" -c 'import numpy, h5py' 2>/dev/null || continue
    package=$(dirname "$(dirname "$(find "$prefix" -path '*/portmet/scene.py')")")
    PYTHONPATH=$package "$python" -c "import portmet, portmet.types
scene = portmet.Scene('$share/configs/double_pendulum.yaml').step(3)
assert scene.steps == 3 and '$prefix' in portmet._library.place('', portmet._places.TRAINER, '')" ||
        fail "the installed Python package"
    break
done

sh "$share/daemon/spy.sh" --help | grep -q usage || fail "the installed spy.sh does not start"

finish
