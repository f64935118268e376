"""Scripts in the style of all pictures, and gnuplot, which draws them."""
import os
import subprocess

# The colours of Okabe and Ito, which remain distinguishable with colour blindness.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#666666")
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


def run(folder, script, text):
    """Writes the script into the folder, which becomes gnuplot's working directory, and draws it."""
    path = os.path.join(folder, script)
    with open(path, "w") as file:
        file.write(text)
    try:
        code = subprocess.run(["gnuplot", script], cwd=folder).returncode
    except FileNotFoundError:
        raise Refused(4, f"gnuplot is not installed (Debian: gnuplot-nox); {path} is written") from None
    if code != 0:
        raise Refused(4, f"gnuplot failed on {path}")


def picture(folder, name, width, height, text):
    """Draws NAME.png, width by height pixels, by NAME.gp."""
    run(folder, name + ".gp",
        f"set terminal pngcairo size {width},{height} font 'DejaVu Sans,11' background 'white'\n"
        f"set output '{name}.png'\n"
        "set border 3 linecolor '#555555'\nset tics nomirror out textcolor '#222222'\n"
        "set grid linetype 1 linecolor '#e4e4e4'\nset key noautotitle samplen 2 spacing 1.1\n" + text)
