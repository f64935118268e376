#!/bin/sh
# test_zoo.sh PORTMET_TRAIN: runs test_zoo.py with the first Python that has what it needs. Without one it is skipped.
for python in python3 /usr/bin/python3; do
    if "$python" -c 'import numpy, scipy, h5py' 2>/dev/null; then
        PYTHONDONTWRITEBYTECODE=1 exec "$python" "$(dirname "$0")/test_zoo.py" "$@"
    fi
done
echo "skipped: no Python 3 with numpy, scipy and h5py (Debian: python3-numpy python3-scipy python3-h5py)"
exit 77
