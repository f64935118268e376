# SPDX-License-Identifier: MIT
"""Turns tables into a dataset, for `portmet-train import` and wherever portmet-train reads tables:

    python3 tables OUTPUT [--time=NAME] [--dt=S] [--missing=NUMBERS] [--runs=NAME] [--types=FILE]
        [--units=NAME=UNIT,...] -- TABLE...

Prints what was left out and changed. A failure is one line on standard error, and the exit code of its class."""
import os
import sys

try:
    import h5py
except ImportError as error:  # goes on with Debian's Python where this one has no packages
    DEBIAN = "/usr/bin/python3"
    if "PORTMET_TABLES" not in os.environ and os.path.exists(DEBIAN) and not os.path.samefile(DEBIAN, sys.executable):
        os.environ["PORTMET_TABLES"] = DEBIAN
        os.execv(DEBIAN, [DEBIAN, "-B", *sys.argv])
    print(f"portmet-train: tables are read by Python, which lacks {error.name}: apt-get install python3-h5py python3-scipy",
          file=sys.stderr)
    sys.exit(4)

import reader  # noqa: E402

sys.exit(reader.main(sys.argv[1:]))
