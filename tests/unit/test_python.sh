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
# A copy of the package, such as pip makes, finds what was built.
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
cp -r "$build/daemon/python/portmet" "$copy"
PYTHONPATH=$copy PATH=/usr/bin:/bin "$(command -v "$found")" -c "import portmet, portmet._places as places, os
portmet.Scene('configs/double_pendulum.yaml').step(1)
assert all(os.path.exists(portmet._library.place('', p, '')) for p in (places.TRAINER, places.DAEMON))" ||
    { echo "FAILED: a copy of the package"; exit 1; }
for script in "$@"; do
    ${network:-} "$found" "$script" || exit 1
done
