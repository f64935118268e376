"""Pictures of `portmetd bench` and `portmetd stress`, from the tables NAME.txt that these have written."""
import os

from gnuplot import picture, quoted


def both(name, text):
    """Draws NAME.png and NAME.svg."""
    folder, base = os.path.split(name)
    picture(folder or ".", base, 900, 650, f"{text}\nset terminal svg size 900,650 dynamic\nset output '{base}.svg'\nreplot\n")


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
    """The map of starts and steps."""
    table = quoted(os.path.basename(name) + ".txt")
    both(name, "set palette defined (0 '#009e73', 0.5 '#e69f00', 1 '#d55e00')\nset cbrange [0:1]\nunset grid\n"
         "set xlabel 'dt, times 2 to this power'\nset ylabel 'widths beyond the training range'\n"
         f"set title 'good (0), drifting (0.5), broken (1)'\nplot {table} matrix with image notitle")
