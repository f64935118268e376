#!/bin/sh
# test_python.sh BUILD SCRIPT...: runs Python tests on the package that the build made, with the first
# Python that has numpy and h5py. Without one it is skipped.
set -u
build=$1
shift
for python in python3 /usr/bin/python3; do
    if "$python" -c 'import numpy, h5py' 2>/dev/null; then
        found=$python
        break
    fi
done
if [ -z "${found:-}" ]; then
    echo "skipped: no Python 3 with numpy and h5py (Debian: python3-numpy python3-h5py)"
    exit 77
fi
export PYTHONPATH="$build/daemon/python" PYTHONDONTWRITEBYTECODE=1
PATH=$build/daemon/app:$build/trainer:$PATH
# Messages stay in a private network where one can be made.
for options in -n -rn; do
    if unshare $options sh daemon/loopback.sh true 2>/dev/null; then
        network="unshare $options sh daemon/loopback.sh"
        break
    fi
done
export PM_PRIVATE_NETWORK="${network:+yes}"
for script in "$@"; do
    ${network:-} "$found" "$script" || exit 1
done
