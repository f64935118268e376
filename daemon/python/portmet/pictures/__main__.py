# SPDX-License-Identifier: MIT
"""Draws the pictures of portmet-train and portmetd with gnuplot, the script of each beside it, and works on files of fields.

    python3 pictures fit FOLDER                                       fit.png from fit.csv, if there is gnuplot
    python3 pictures evaluation FOLDER                                from the tables that `evaluate` wrote there
    python3 pictures estimate FOLDER DATA NAME SECONDS UNTIL          from predictions.h5 and the dataset NAME of DATA
    python3 pictures columns FOLDER DATA NAME                         measured.png: the dataset NAME of DATA
    python3 pictures boxes FOLDER TITLE TABLE TABLE LABEL...          errors.png: tested, and trained on ('': none)
    python3 pictures bench NAME                                       NAME.png and .svg from NAME.txt, a block for each method
    python3 pictures stress NAME                                      NAME.png and .svg from NAME.txt, a map
    python3 pictures bodies FIELD... --output FILE [options]          as `portmet-train picture --help` says
    python3 pictures xdmf FIELD                                       FIELD's name with .xdmf: for ParaView
    python3 pictures correct FILE COMMAND LIST FIELD FIELD            FILE: the first FIELD, corrected by the second

A failure is one line on standard error, and the exit code of its class."""
import os
import sys

sys.path.append(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tables"))
from gnuplot import Refused  # noqa: E402

FILE = 4  # exit code


def main(kind, *words):
    if kind not in ("fit", "evaluation", "boxes", "bench", "stress"):
        try:
            import h5py  # noqa: F401
        except ImportError as error:  # goes on with Debian's Python where this one has no packages
            debian = "/usr/bin/python3"
            if "PORTMET_PICTURES" not in os.environ and os.path.exists(debian) and not os.path.samefile(debian, sys.executable):
                os.environ["PORTMET_PICTURES"] = debian
                os.execv(debian, [debian, "-B", *sys.argv])
            raise Refused(FILE, f"pictures are drawn by Python, which lacks {error.name}: apt-get install python3-h5py") from None
    if kind in ("bodies", "xdmf", "correct"):
        import bodies
        import correction
        import xdmf
        {"bodies": bodies.draw, "xdmf": xdmf.describe, "correct": correction.run}[kind](*words)
    elif kind in ("estimate", "columns"):
        import measured
        getattr(measured, kind)(*words)
    elif kind in ("bench", "stress"):
        import studies
        getattr(studies, kind)(*words)
    else:
        import errors
        getattr(errors, kind)(*words)


try:
    main(*sys.argv[1:])
except Refused as refused:
    print(f"portmet-train: {refused}", file=sys.stderr)
    sys.exit(refused.code)
except OSError as error:
    print(f"portmet-train: {error.filename}: {error.strerror}" if error.filename else f"portmet-train: {error}", file=sys.stderr)
    sys.exit(FILE)
