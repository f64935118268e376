# SPDX-License-Identifier: MIT
"""Scripts in the style of all pictures, and gnuplot, which draws them."""
import os
import struct
import subprocess
import zlib

# The colours of Okabe and Ito, which remain distinguishable with colour blindness.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#666666")
MARK = "#: of a picture by portmet"  # every file of a picture has it among its first bytes (daemon/base/files.h)
PNG, PNG_HEAD = b"\x89PNG", 33  # how a picture begins, and the bytes of its signature and its first chunk
LOG_AXIS = "set logscale y\nunset mytics\nset format y '10^{%L}'\n"


class Refused(Exception):
    """A failure: the exit code of its class, and one line."""

    def __init__(self, code, text):
        super().__init__(text)
        self.code = code


def colour(i):
    return COLOURS[i % len(COLOURS)]


def quoted(text):
    return "'" + text.replace("'", "''") + "'"


def create(path):
    """Opens a table or a script for writing, below the mark. The program that calls has checked what it replaces."""
    file = open(path, "w")
    file.write(MARK + "\n")
    return file


def sign(path):
    """Adds the mark to a picture: as a text chunk of PNG, or as a comment in the second line of SVG."""
    with open(path, "rb") as file:
        data = file.read()
    if data.startswith(PNG):
        chunk = b"tEXt" + b"Comment\0" + MARK.encode()
        added, at = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)), PNG_HEAD
    else:
        added, at = f"<!-- {MARK} -->\n".encode(), data.find(b"\n") + 1
    with open(path, "wb") as file:
        file.write(data[:at] + added + data[at:])


def run(folder, script, text, *drawn):
    """Writes the script into the folder, which becomes gnuplot's working directory, and draws the pictures `drawn`."""
    path = os.path.join(folder, script)
    with create(path) as file:
        file.write(text)
    try:
        code = subprocess.run(["gnuplot", script], cwd=folder).returncode
    except FileNotFoundError:
        raise Refused(4, f"gnuplot is not installed (Debian: gnuplot-nox); {path} is written") from None
    if code != 0:
        raise Refused(4, f"gnuplot failed on {path}")
    for name in drawn:
        sign(os.path.join(folder, name))


def picture(folder, name, width, height, text, *more):
    """Draws NAME.png, width by height pixels, and the pictures `more` by NAME.gp."""
    run(folder, name + ".gp",
        f"set terminal pngcairo size {width},{height} font 'DejaVu Sans,11' background 'white'\n"
        f"set output '{name}.png'\n"
        "set border 3 linecolor '#555555'\nset tics nomirror out textcolor '#222222'\n"
        "set grid linetype 1 linecolor '#e4e4e4'\nset key noautotitle samplen 2 spacing 1.1\n" + text, name + ".png", *more)
