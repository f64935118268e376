#!/bin/sh
# Everything that must hold before a commit: builds with gcc and with clang, where every warning is an error; runs the
# unit and property tests of clang's build under AddressSanitizer and UndefinedBehaviorSanitizer, then all tests of
# gcc's. Ends with ctest's summary. Without the second build: SANITIZE=no sh tests/run.sh
#   sh tests/run.sh fast      one build and its fast tests alone: less than three minutes on two cores
set -eu
cd "$(dirname "$0")/.."
. daemon/setup.sh

need_packages $build_packages $test_packages
build_into build -DPM_WERROR=ON
if [ "${1:-}" = fast ]; then
    exec ctest --test-dir build -L fast --output-on-failure -j "$(nproc)"
fi

failed=0
if [ "${SANITIZE:-yes}" = yes ]; then
    build_into build-clang -DCMAKE_C_COMPILER=clang -DPM_SANITIZE=address,undefined -DPM_WERROR=ON
    for kind in unit property; do
        echo "$kind tests under the sanitizers"
        quietly "build-clang/$kind.log" ctest --test-dir "build-clang/tests/$kind" \
            --output-on-failure -j "$(nproc)" || failed=1
    done
fi

ctest --test-dir build --output-on-failure -j "$(nproc)" || failed=1
exit $failed
