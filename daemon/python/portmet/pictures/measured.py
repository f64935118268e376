# SPDX-License-Identifier: MIT
"""Pictures of measurements, and of predictions from estimated starts beside them."""
import math

import h5py
import numpy

from gnuplot import colour, create, picture, quoted, run
from portmet_files import expand, text

NINETY_PER_CENT = 1.6448536269514722  # deviations of a normal distribution
MOST_DRAWN = 4  # trajectories
MOST_ROWS = 1500  # of a drawn trajectory; more would overlap
BINS = 12  # of the time, in which coverage is counted


def read(path, name):
    """The names of the columns, with their units where they are known; values [trajectory][time][column] and times
    [trajectory][time] since the first one."""
    with h5py.File(path, "r") as file:
        y, t = file[name][()], file["t"][()]
        names = expand(text(file.attrs["state_layout"]))
        units = text(file.attrs["units"]).split(";") if "units" in file.attrs else [""] * len(names)
    t = t if t.ndim == 2 else numpy.tile(t, (len(y), 1))
    return names, units, y, t - t[:, :1]


def label(name, unit):
    return f"{name}, {unit}" if unit else name


def columns(folder, data, name):
    names, units, y, t = read(data, name)
    with create(folder + "/measured.txt") as file:
        for time, rows in zip(t, y):
            there = numpy.isfinite(time)
            numpy.savetxt(file, numpy.column_stack((time, rows))[there], "%.9g")
            file.write("\n")
    panels = "".join(f"set ylabel {quoted(label(name, unit))}\n" + ("set xlabel 'time, s'\n" if c + 1 == len(names) else "") +
                     f"plot 'measured.txt' using 1:{c + 2} with lines lw 0.5 linecolor '#0072b2' notitle\n"
                     for c, (name, unit) in enumerate(zip(names, units)))
    run(folder, "measured.gp",
        f"set terminal pngcairo size 900,{60 + 170 * len(names)} font 'DejaVu Sans,10' background 'white'\n"
        f"set output 'measured.png'\nset multiplot layout {len(names)},1\nset border 3\nset tics nomirror out\n"
        f"set datafile missing 'nan'\n{panels}unset multiplot\n", "measured.png")


def estimate(folder, data, name, seconds, until):
    """Predictions, and the share of the measurements in their bands. All trajectories count, MOST_DRAWN are drawn."""
    names, units, y, t = read(data, name)
    seconds, until = float(seconds), float(until)
    with h5py.File(folder + "/predictions.h5", "r") as file:
        which, predicted = file["trajectory"][()].astype(int), file["y"][()]
        units = [own or text(known) for own, known in zip(units, file.attrs["units"])]
        half = NINETY_PER_CENT * numpy.abs(file["deviation"][()]) if "deviation" in file else None
    y, t = y[which], t[which]
    own = [c for c in range(len(names)) if numpy.isfinite(predicted[:, :, c]).any()]
    for i in range(min(len(which), MOST_DRAWN)):
        draw_prediction(folder, which[i], [label(names[c], units[c]) for c in own], t[i], y[i][:, own], predicted[i][:, own],
                        None if half is None else half[i][:, own], seconds, until)
    if half is None:
        return
    edges = numpy.linspace(seconds, until, BINS + 1)
    inside, rows = numpy.abs(predicted - y) <= half, []
    for begin, end in zip(edges, edges[1:]):
        there = (t > begin) & (t <= end)
        known = [there & numpy.isfinite(y[:, :, c]) for c in own]
        rows.append([(begin + end) / 2, *(100 * inside[:, :, c][k].mean() if k.any() else math.nan for c, k in zip(own, known))])
    with create(folder + "/coverage.txt") as file:
        numpy.savetxt(file, rows, "%.9g")
    picture(folder, "coverage", 800, 420,
            "set xlabel 'time, s'\nset ylabel 'measurements inside bands of 90 %, %'\n"
            f"set xrange [0:{until:.9g}]\nset yrange [0:100]\nset key outside right top noenhanced\n"
            "plot 90 with lines dashtype 3 linecolor '#555555' notitle" +
            "".join(f", 'coverage.txt' using 1:{2 + k} with linespoints pointtype 7 linecolor '{colour(k)}' title {quoted(names[c])}"
                    for k, c in enumerate(own)) + "\n")


def draw_prediction(folder, number, labels, t, y, predicted, half, seconds, until):
    """On the left each measured column and its prediction, on the right measurement minus prediction. The table has four
    numbers for each column: measured, predicted, half the band, measured minus predicted."""
    rows = numpy.flatnonzero(t <= until)[::1 + len(t) // MOST_ROWS]
    table = numpy.stack((y, predicted, numpy.zeros_like(y) if half is None else half, y - predicted), axis=2)
    data, n = f"prediction_{number}.txt", len(labels)
    with create(f"{folder}/{data}") as file:
        numpy.savetxt(file, numpy.column_stack((t, table.reshape(len(t), -1)))[rows], "%.9g")
    script = (f"set multiplot layout {n},2 title 'Trajectory {number}'\n"
              "set key at screen 0.98, screen 0.99 right top horizontal font ',10' samplen 1.2 width -1\n"
              f"set lmargin 12\nset rmargin 2\nset xrange [0:{until:.9g}]\n"
              f"set arrow from {seconds:.9g}, graph 0 to {seconds:.9g}, graph 1 nohead dashtype 3 linecolor '#555555'\n")
    for c, axis in enumerate(labels):
        first, end = 2 + 4 * c, "time, s" if c + 1 == n else ""
        script += f"set xlabel '{end}'\n"
        for shown, centre, title in (first, f"${first + 1}", axis), (first + 3, "0", "difference: " + axis):
            script += ("" if shown == first else "unset key\n") + f"set ylabel {quoted(title)} noenhanced\nplot "
            if half is not None:
                script += (f"'{data}' using 1:({centre}-${first + 2}):({centre}+${first + 2}) with filledcurves "
                           "fillcolor '#a6cee3' title 'band of 90 %', ")
            script += (f"'{data}' using 1:{shown} with points pointtype 7 pointsize 0.25 linecolor '#222222' title 'measured', "
                       f"'' using 1:({centre}) with lines linewidth 1.4 linecolor '{colour(0)}' title 'predicted'\n")
    picture(folder, f"prediction_{number}", 1100, 80 + 190 * n, script)
