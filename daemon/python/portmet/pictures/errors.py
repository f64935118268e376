# SPDX-License-Identifier: MIT
"""Pictures of errors: of a fit, of an evaluation, of fields. They come from tables of text."""
import csv
import math
import os
import statistics

from gnuplot import LOG_AXIS, MARK, Refused, colour, create, picture, quoted

FEWEST_ROWS = 3  # of fit.csv: gnuplot warns about empty ranges
MOST_POINTS = 250  # of a true trajectory; more would overlap
SMALLEST = 1e-12  # what a logarithmic axis shows of a smaller drift, J


def fit(folder):
    with open(folder + "/fit.csv") as file:
        rows = list(csv.DictReader(file))
    if len(rows) < FEWEST_ROWS:
        return
    text = ("set datafile separator ','\n" + LOG_AXIS + "set xlabel 'time of training, s'\n"
            # Losses of different stages are different quantities: no line joins them.
            + "plot " + ", ".join(f"'fit.csv' using 4:($1 == {stage} ? $5 : NaN) every ::1 with lines "
                                  f"linecolor '{colour(i)}' title 'loss, stage {stage}'"
                                  for i, stage in enumerate(sorted({row["stage"] for row in rows}, key=int))))
    if any(row["validation"] for row in rows):
        text += (", 'fit.csv' using 4:6 every ::1 with points pointtype 7 linecolor '#222222' "
                 "title 'rollouts on the validation part: error relative to persistence'")
    try:
        picture(folder, "fit", 900, 450, text + "\n")
    except (Refused, OSError):
        pass  # a fit does not fail for its picture


def table(path):
    """Reads a table: the names behind `#` in the line below the mark, and its rows of numbers."""
    with open(path) as file:
        file.readline()
        names = file.readline().lstrip("# ").split()
        return names, [[float(x) for x in line.split()] for line in file]


def write(path, rows):
    with create(path) as file:
        for row in rows:
            file.write(" ".join(f"{x:.9g}" for x in row) + "\n")


def spread(values):
    """Smallest, quartiles and largest of some numbers."""
    values = sorted(values)
    return [values[0], *(statistics.quantiles(values, method="inclusive") if len(values) > 1 else 3 * values), values[-1]]


def box(data, at, column, group, opacity):
    return (f"'{data}' using ({at:g}):{column} pointtype 7 pointsize 0.3 linewidth 1.2 linecolor '{colour(group)}' "
            f"fillstyle solid {opacity:g}")


def panel_of_boxes(labels, title, trained, tested, first):
    """Boxes for each of the labels from the tables `trained`, pale, and `tested`, whose columns begin with `first`."""
    both = trained and tested
    sets = [(trained, -0.18 if both else 0, 0.1)] * bool(trained) + [(tested, 0.18 if both else 0, 0.5)] * bool(tested)
    ticks = ", ".join(f"{quoted(label)} {g + 1}" for g, label in enumerate(labels))
    return ("set style data boxplot\nset grid noxtics ytics\n" + LOG_AXIS + "set ylabel 'relative L_2 error, %'\n"
            f"set xtics scale 0 ({ticks})\nset xrange [0.4:{len(labels)}.6]\nset boxwidth {0.3 if both else 0.5:g}\n"
            f"set title {quoted(title)}\nplot " +
            ", ".join(box(data, g + 1 + shift, g + first, g, opacity) for data, shift, opacity in sets for g in range(len(labels))) +
            "\n")


def boxes(folder, title, tested, trained, *labels):
    files = [name if name and os.path.getsize(f"{folder}/{name}") > len(MARK) + 1 else "" for name in (trained, tested)]
    picture(folder, "errors", 600, 450, panel_of_boxes(labels, title, *files, 1))


def band(data, first, line, extremes):
    """The median as a line and the quartiles as a band, with `extremes` also smallest to largest."""
    fill = f"with filledcurves fillcolor '{line}' fillstyle transparent solid"
    text = f"'{data}' using 1:{first}:{first + 4} {fill} 0.12 noborder title 'smallest to largest', " if extremes else ""
    return (f"{text}'{data}' using 1:{first + 1}:{first + 3} {fill} 0.3 noborder title 'quartiles', "
            f"'' using 1:{first + 2} with lines linewidth 1.6 linecolor '{line}' title 'median'\n")


def evaluation(folder):
    names, snapshots = table(folder + "/snapshots.txt")
    _, trajectories = table(folder + "/trajectories.txt")
    groups = names[2:-2]
    draw_errors(folder, groups, len(trajectories), len(snapshots))
    draw_trajectory(folder)
    by_time = {}
    for row in snapshots:
        by_time.setdefault(row[1], []).append(row)
    times = sorted(by_time)
    begin = {int(row[0]): row for row in trajectories}
    draw_growth(folder, groups, times, by_time, len(trajectories), trajectories[0][1])
    if not math.isnan(trajectories[0][-2]):
        draw_laws(folder, times, by_time, begin)


def draw_errors(folder, groups, ntrajectory, nsnapshot):
    """One panel for trajectories and one for snapshots."""
    text = "set multiplot layout 1,2\n"
    for word, data, count in ("trajectory", "trajectories.txt", ntrajectory), ("snapshot", "snapshots.txt", nsnapshot):
        trained, title = "", f"per {word} ({count})"
        if os.path.exists(f"{folder}/trained_{data}"):
            trained = "trained_" + data
            title = f"per {word}: train ({len(table(f'{folder}/{trained}')[1])}, pale), test ({count})"
        text += panel_of_boxes(groups, title, trained, data, 3)
    picture(folder, "errors", 900, 450, text)


def draw_trajectory(folder):
    """Predictions as lines and true states as points, in one panel for each group."""
    with open(folder + "/states.txt") as file:
        file.readline()  # the mark
        number, *axes = file.readline().lstrip("# ").rstrip("\n").split("\t")
        column_group = [int(x) for x in file.readline().split()[1:]]
        columns = file.readline().split()[1:]
        last = [line.split()[0] for line in file]
    every, n = len(last) // MOST_POINTS + 1, len(columns)
    text = (f"set multiplot layout {len(axes)},1 title 'Trajectory {number}: predicted (lines), true (points)'\n"
            f"set key outside right top\nset lmargin 11\nset rmargin 10\nset xrange [{last[0]}:{last[-1]}]\n")
    for g, axis in enumerate(axes):
        own = [i for i in range(n) if column_group[i] == g]
        text += f"set ylabel {quoted(axis)}\nset xlabel '{'time, s' if g + 1 == len(axes) else ''}'\nplot " + ", ".join(
            f"'states.txt' every {every} using 1:{i + 2} with points pointtype 7 pointsize 0.45 linecolor '{colour(k)}', "
            f"'' using 1:{n + i + 2} with lines linewidth 1.2 linecolor '{colour(k)}' title {quoted(columns[i])}"
            for k, i in enumerate(own)) + "\n"
    picture(folder, "trajectory", 1000, 50 + 250 * len(axes), text)


def draw_growth(folder, groups, times, by_time, count, start):
    """The errors of states over time."""
    write(folder + "/growth.txt", ([t - start, *(x for g in range(len(groups)) for x in spread([row[2 + g] for row in by_time[t]]))]
                                   for t in times))
    text = (f"set multiplot layout {len(groups)},1 title 'Error growth over {count} trajectories'\nset key outside right top\n"
            f"set lmargin 11\nset rmargin 15\nset xrange [0:{times[-1] - start:.9g}]\n" + LOG_AXIS)
    for g, group in enumerate(groups):
        text += (f"set ylabel {quoted(f'relative error of {group}, %')}\nset xlabel '{'time, s' if g + 1 == len(groups) else ''}'\n" +
                 ("set key off\n" if g == 1 else "") + "plot " + band("growth.txt", 2 + 5 * g, colour(g), False))
    picture(folder, "growth", 1000, 60 + 250 * len(groups), text)


def draw_laws(folder, times, by_time, begin):
    """Energy and entropy over time. At each time, rollouts that are no longer finite are left out."""
    rows = []
    start = min(row[1] for row in begin.values())
    for t in times:
        pairs = [(row, begin[int(row[0])]) for row in by_time[t] if not math.isnan(row[-2])]
        if pairs:
            rows.append([t - start, *spread([max(abs(row[-2] - first[-2]), SMALLEST) for row, first in pairs]),
                         *spread([row[-1] - first[-1] for row, first in pairs])])
    if not rows:
        return
    write(folder + "/laws.txt", rows)
    picture(folder, "laws", 1000, 640,
            f"set multiplot layout 2,1 title 'Both laws over {len(begin)} trajectories'\nset key outside right top\n"
            f"set lmargin 13\nset rmargin 24\nset xrange [0:{times[-1] - start:.9g}]\nset title 'drift of the total energy'\n" +
            LOG_AXIS + "set ylabel '|E(t) - E(0)|, J'\nplot " + band("laws.txt", 2, colour(0), True) +
            "unset logscale y\nset format y '%g'\nset xlabel 'time, s'\nset key off\nset title 'change of the total entropy'\n"
            "set ylabel 'S(t) - S(0), J/K'\nplot " + band("laws.txt", 7, colour(2), True))
