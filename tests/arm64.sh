#!/bin/sh
# arm64.sh [SYSROOT]: builds for arm64 on a Debian 12 machine and runs the unit and property tests under qemu, but those
# that start other programs without the emulator, limit their own memory, which it does not support, or take minutes.
# Debian's arm64 libraries are collected in SYSROOT (/srv/arm64), and nothing of them is installed; it needs root.
set -eu
cd "$(dirname "$0")/.."
. daemon/setup.sh
sysroot=${1:-/srv/arm64}
need_packages cmake make pkg-config gcc-aarch64-linux-gnu qemu-user-static mmdebstrap
if [ ! -d "$sysroot/usr/include" ]; then
    libraries=libc6-dev,libgcc-12-dev,liblcm-dev,libglib2.0-dev,libhdf5-dev,libsodium-dev,libopenblas-dev,libyaml-dev
    mmdebstrap --mode=root --variant=extract --architectures=arm64 \
        --include=$libraries,libcmocka-dev,libsundials-dev,libsuitesparse-dev,liblbfgs-dev bookworm "$sysroot"
fi
build_into build-arm64 --toolchain tests/arm64.cmake "-DCMAKE_SYSROOT=$sysroot"
others='cli|fit$|noise|layers|source|structure|mentions|format|tidy|keys|install|package|python|launch|dataset$|base$|check$'
ctest --test-dir build-arm64/tests/unit -j "$(nproc)" --output-on-failure -E "$others"
ctest --test-dir build-arm64/tests/property -j "$(nproc)" --output-on-failure
qemu-aarch64-static -L "$sysroot" build-arm64/daemon/app/portmetd run configs/double_pendulum.yaml --in-process
