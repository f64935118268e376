#!/bin/sh
# Everything that must hold before a commit: builds with gcc, and the unit and property tests also with clang, where every
# warning is an error; runs these under AddressSanitizer and UndefinedBehaviorSanitizer, then all tests of gcc's build but
# the long forms. Ends with ctest's summary. Without the second build: SANITIZE=no sh tests/run.sh
#   sh tests/run.sh fast      one build and its fast tests alone: less than three minutes on two cores
set -eu
cd "$(dirname "$0")/.."
. daemon/setup.sh

need_packages $build_packages $test_packages
build_into build -DPM_WERROR=ON
if [ "${1:-}" = fast ]; then
    exec ctest --test-dir build -L fast --output-on-failure -j "$(nproc)"
fi

# Some tests mostly wait for other processes: with two tests more than there are cores all cores are busy.
tests=$(($(nproc) + 2))
failed=0
if [ "${SANITIZE:-yes}" = yes ]; then
    build_into build-clang -DCMAKE_C_COMPILER=clang -DPM_SANITIZE=address,undefined -DPM_WERROR=ON
    export PM_READ_BY_CLANG="$PWD/build-clang" # test_clang leaves out what is compiled there
    for kind in unit property; do
        echo "$kind tests under the sanitizers"
        quietly "build-clang/$kind.log" ctest --test-dir "build-clang/tests/$kind" -LE long \
            --output-on-failure -j "$tests" || failed=1
    done
fi

ctest --test-dir build -LE long --output-on-failure -j "$tests" || failed=1
exit $failed
