# SPDX-License-Identifier: MIT
"""Pictures of `portmetd bench` and `portmetd stress`, from the tables NAME.txt that these have written."""
import math
import os

from gnuplot import picture, quoted


def both(name, text):
    """Draws NAME.png and NAME.svg."""
    folder, base = os.path.split(name)
    picture(folder or ".", base, 900, 650, f"{text}\nset terminal svg size 900,650 dynamic\nset output '{base}.svg'\nreplot\n",
            base + ".svg")


def bench(name):
    """Run time over error. Each block of the table has the title of its method in the line above; the first one is the scene."""
    with open(name + ".txt") as file:
        titles = [line[2:].strip() for line in file if line.startswith("# ")]
    table = quoted(os.path.basename(name) + ".txt")
    blocks = [f"{table} index {i} with {'points pointtype 7 pointsize 2' if i == 0 else 'linespoints'} title {quoted(title)} noenhanced"
              for i, title in enumerate(titles)]
    both(name, "set logscale xy\nset format xy '10^{%L}'\nset key outside right\nset xlabel 'relative error of the states'\n"
         "set ylabel 'CPU time for a simulated second, s'\nplot " + ", ".join(blocks))


def stress(name):
    """The map of starts and steps, without places from which no rollout was made."""
    with open(name + ".txt") as file:
        rows = [[float(word) for word in line.split()] for line in file if not line.startswith("#")]
    cells = [f"{x} {y} {value}" for y, row in enumerate(rows) for x, value in enumerate(row) if not math.isnan(value)]
    both(name, "set palette defined (0 '#009e73', 0.5 '#e69f00', 1 '#d55e00')\nset cbrange [0:1]\nunset grid\n"
         f"set xrange [-0.5:{len(rows[0]) - 0.5}]\nset yrange [-0.5:{len(rows) - 0.5}]\n"
         "set xlabel 'dt, times 2 to this power'\nset ylabel 'widths beyond the training range'\n"
         "set title 'good (0), drifting (0.5), broken (1)'\n$map << END\n" + "\n".join(cells) +
         "\nEND\nplot $map using 1:2:(0.5):(0.5):3 with boxxyerror fillstyle solid linecolor palette notitle")
