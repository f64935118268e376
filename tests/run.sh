#!/bin/sh
# Everything that must hold before a commit: builds, runs the unit and property tests under
# AddressSanitizer and UndefinedBehaviorSanitizer, then all tests. Ends with ctest's summary.
# Without the sanitizers (a second build): SANITIZE=no sh tests/run.sh
set -eu
cd "$(dirname "$0")/.."
. daemon/setup.sh

need_packages $build_packages $test_packages
build_into build

failed=0
if [ "${SANITIZE:-yes}" = yes ]; then
    build_into build-asan -DPM_SANITIZE=address,undefined
    for kind in unit property; do
        echo "$kind tests under the sanitizers"
        quietly "build-asan/$kind.log" ctest --test-dir "build-asan/tests/$kind" \
            --output-on-failure -j "$(nproc)" || failed=1
    done
fi

ctest --test-dir build --output-on-failure -j "$(nproc)" || failed=1
exit $failed
