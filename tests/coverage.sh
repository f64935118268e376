#!/bin/sh
# coverage.sh [CTEST-OPTION...]: which lines of daemon/ and trainer/ the tests run. Builds in build-coverage, runs all
# tests (or those of the options, such as -L fast), and writes build-coverage/coverage.txt, a table of all files, and
# build-coverage/coverage/index.html. Prints the lines of both folders. Fails if less than 90 % of daemon/ has run.
set -eu
cd "$(dirname "$0")/.."
. daemon/setup.sh
need_packages $build_packages $test_packages gcovr
build_into build-coverage -DPM_COVERAGE=ON
find build-coverage -name '*.gcda' -delete
ctest --test-dir build-coverage -j "$(nproc)" "$@" >build-coverage/tests.log 2>&1 ||
    echo "some tests fail: build-coverage/tests.log" >&2
mkdir -p build-coverage/coverage
# The exported sources and the examples are compiled elsewhere. Threads may spoil a count, which is then left out.
set -- -r . --object-directory build-coverage --exclude daemon/examples/ --exclude daemon/export/fmi/ --gcov-ignore-parse-errors
gcovr "$@" --filter daemon/ --filter trainer/ --txt build-coverage/coverage.txt --html-details build-coverage/coverage/index.html
for folder in daemon trainer; do
    echo "$folder: $(gcovr "$@" --filter $folder/ --print-summary --txt /dev/null | grep '^lines:')"
done
gcovr "$@" --filter daemon/ --fail-under-line 90 --txt /dev/null >/dev/null
