# SPDX-License-Identifier: MIT
# What quickstart.sh, spy.sh and tests/run.sh have in common: Debian packages, the build, a private
# network. Sourced from the repository's root by a script that runs under `set -eu`.

build_packages="cmake make gcc libc6-dev pkg-config liblcm-dev liblcm-bin libglib2.0-dev libhdf5-dev
    libsodium-dev libopenblas-dev libyaml-dev libcmocka-dev libsundials-dev libsuitesparse-dev liblbfgs-dev
    libwebsockets-dev gnuplot-nox iproute2 nftables hdf5-tools python3 python3-h5py python3-scipy"

# What the tests use besides: runs over MPI, meshes by Gmsh, cuts of scenes by METIS, a second compiler and its
# sanitizers, the layout.
test_packages="libopenmpi-dev openmpi-bin libgmsh-dev libmetis-dev clang libclang-rt-dev clang-format
    clang-tidy"

# The folder for logs of what is installed.
logs=build

# quietly LOG COMMAND...: the output goes to LOG; its end is shown if the command fails.
quietly() {
    log=$1
    shift
    if ! "$@" >"$log" 2>&1; then
        tail -n 40 "$log" >&2
        echo "failed: $* (all of it: $log)" >&2
        return 1
    fi
}

# need_packages PACKAGE...: installs those that are missing, as root or with sudo.
need_packages() {
    missing=
    for package in "$@"; do
        dpkg -s "$package" 2>/dev/null | grep -q '^Status: install ok installed' ||
            missing="$missing $package"
    done
    [ -n "$missing" ] || return 0
    echo "installing Debian packages:$missing"
    if [ "$(id -u)" -eq 0 ]; then
        as_root="env DEBIAN_FRONTEND=noninteractive"
    elif command -v sudo >/dev/null; then
        as_root="sudo env DEBIAN_FRONTEND=noninteractive"
    else
        echo "not root, and no sudo: install them, then run this again" >&2
        return 1
    fi
    mkdir -p "$logs"
    quietly "$logs/packages.log" $as_root apt-get update
    quietly "$logs/packages.log" $as_root apt-get install -y --no-install-recommends $missing
}

# build_into DIR [CMAKE-OPTION...]: configures and builds the whole tree in DIR.
build_into() {
    directory=$1
    shift
    mkdir -p "$directory"
    if [ ! -f "$directory/CMakeCache.txt" ] && command -v ninja >/dev/null; then
        set -- -G Ninja "$@"
    fi
    echo "building in $directory"
    quietly "$directory/configure.log" cmake -S . -B "$directory" "$@"
    quietly "$directory/build.log" cmake --build "$directory" -j "$(nproc)"
}

# Prints how to start a command in a network of its own, or nothing where that is not allowed.
private_network() {
    for options in -n -rn; do
        if unshare $options sh daemon/loopback.sh true 2>/dev/null; then
            echo "unshare $options sh daemon/loopback.sh"
            return
        fi
    done
}
