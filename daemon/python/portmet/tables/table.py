# SPDX-License-Identifier: MIT
"""What all readers of tables have in common: a run, how a run is refused, which column has the times."""
import re

import numpy

FILE, DATA = 4, 5  # exit codes: a file cannot be read; its content is wrong

MOST_COLUMNS = 1000
TIME_UNITS = {"s": 1, "sec": 1, "ms": 1e-3, "us": 1e-6, "\xb5s": 1e-6, "\u03bcs": 1e-6, "ns": 1e-9, "min": 60,
              "h": 3600, "day": 86400}
TIME_NAMES = ("t", "time", "timestamp", "time_stamp", "datetime", "date_time", "elapsed", "elapsed_time", "x_value", "zeit",
              "temps", "tiempo", "tempo")
BRACKETS = re.compile(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$", re.DOTALL)  # a name and a unit
SUFFIXED = re.compile(r"(?:t|time)_(s|ms|us|ns|min|h)", re.IGNORECASE)
# Times without a unit that can only be times since 1970, by their size: ns, us, ms.
SINCE_1970 = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))


class Refused(Exception):
    """A table that is not read: the exit code, and one line that says why."""

    def __init__(self, code, text):
        super().__init__(text)
        self.code = code


def say(text):
    print(text, flush=True)


class Run:
    """A table of one trajectory: names and units of the columns, value [row][column] (NaN: no sample), and `line`
    [row], the line of the file that holds a row, or None. `stamps` are the names of the columns that were times of the
    day or dates; their values are s since the first one."""

    def __init__(self, path, names, values, units=None, line=None, stamps=()):
        self.path, self.names, self.value, self.line, self.stamps = path, list(names), values, line, set(stamps)
        self.units = [""] * len(self.names) if units is None else list(units)

    def at(self, row):
        return self.path if self.line is None else f"{self.path}:{self.line[row]}"

    def keep_columns(self, kept):
        self.names, self.units = ([of[i] for i in kept] for of in (self.names, self.units))
        self.value = self.value[:, kept]

    def keep_rows(self, kept):
        self.value = self.value[kept]
        self.line = None if self.line is None else numpy.asarray(self.line)[kept]


def is_time_name(name):
    return name.lower() in TIME_NAMES or SUFFIXED.fullmatch(name) is not None


def is_index(values):
    """Tells whether a column counts its rows, from 0 or 1."""
    return len(values) > 0 and values[0] in (0, 1) and numpy.array_equal(values, values[0] + numpy.arange(len(values)))


def drop_unnamed(run):
    """Leaves out columns without a name that hold nothing or count the rows (the index that pandas writes), and gives
    the others a name: `time` to a first column that rises where no other one has the times."""
    kept = []
    for i, name in enumerate(run.names):
        column = run.value[:, i]
        unnamed = not name or re.fullmatch(r"Unnamed:_\d+|__index_level_\d+__", name)
        if unnamed and (numpy.isnan(column).all() or is_index(column)):
            continue
        if unnamed:
            times = i == 0 and not any(map(is_time_name, run.names)) and (numpy.diff(column) > 0).all()
            run.names[i] = "time" if times else f"column_{i + 1}"
        kept.append(i)
    run.keep_columns(kept)


def refuse_repeated_names(run):
    if len(run.names) > MOST_COLUMNS:
        raise Refused(DATA, f"{run.path}: {len(run.names)} columns, expected at most {MOST_COLUMNS}")
    for i, name in enumerate(run.names):
        if name in run.names[:i]:
            raise Refused(DATA, f'{run.path}: two columns have the name "{name}"')


def find_time(run, given):
    """Returns the position of the column with the times."""
    if given is not None:
        same = [i for i, name in enumerate(run.names) if name == given]
        same = same or [i for i, name in enumerate(run.names) if name.lower() == given.lower()]
    else:
        # A "T" with another unit, or beside another column with times, is a temperature.
        may = [i for i, unit in enumerate(run.units) if not unit or unit in TIME_UNITS]
        same = [i for i in may if run.names[i] in run.stamps and is_time_name(run.names[i])]
        same += [i for wanted in TIME_NAMES for i in may if run.names[i].lower() == wanted and run.names[i] != "T"]
        same += [i for i in may if SUFFIXED.fullmatch(run.names[i]) or run.names[i] in run.stamps]
        same += [i for i in may if run.names[i] == "T"]
        same += [i for i, name in enumerate(run.names) if is_time_name(name)]  # refused by its unit
    if not same:
        raise Refused(DATA, f'{run.path}: there is no column "{given or "t"}" with times; name it with --time, or give '
                            f'the time between two rows with --dt; the columns are: {" ".join(run.names)[:255]}')
    return same[0]


def take_times(run, given, dt):
    """Takes the column with the times out of the run, or counts rows if the time between two rows is given. Sets
    run.time [row], s, rising. Rows without a time and rows that repeat a time are left out; returns both numbers."""
    if dt is not None and given is None:
        run.time = dt * numpy.arange(len(run.value))
        return 0, 0
    bracket = BRACKETS.fullmatch(given) if given is not None and given not in run.names else None
    given = bracket[1] if bracket else given
    at = find_time(run, given)
    name, unit, time = run.names[at], run.units[at], run.value[:, at].copy()
    run.keep_columns([i for i in range(len(run.names)) if i != at and run.names[i] not in run.stamps])
    there = numpy.isfinite(time)
    run.keep_rows(there)
    time = time[there]
    if len(time) < 2:
        raise Refused(DATA, f"{run.path}: {len(time)} rows of numbers with a time, expected two or more")
    suffix = SUFFIXED.fullmatch(name)
    unit = bracket[2] if bracket else suffix[1].lower() if suffix and not unit else unit
    if name not in run.stamps:
        if unit and unit not in TIME_UNITS:
            raise Refused(DATA, f'{run.path}: column "{name}": "{unit[:40]}" is no unit of time, such as s or ms')
        factor = next((f for least, f in SINCE_1970 if not unit and time[0] >= least), TIME_UNITS.get(unit, 1))
        if time[0] * factor > 1e8:  # since 1970: a difference has more digits
            time = (time - time[0]) * factor
        else:
            time = time * factor
    falls = numpy.flatnonzero(time < numpy.maximum.accumulate(time))
    if len(falls) > 0:
        k = falls[0]
        raise Refused(DATA, f"{run.at(k)}: the time {time[k]:.9g} s follows {time[k - 1]:.9g} s, expected rising times; "
                            "several runs in one file need --runs with the column that tells them apart")
    first = numpy.concatenate(([True], numpy.diff(time) > 0))
    run.keep_rows(first)
    run.time = time[first]
    if len(run.time) < 2:
        raise Refused(DATA, f"{run.path}: all rows have the time {time[0]:.9g} s, expected rising times")
    return int((~there).sum()), int((~first).sum())


def divide(run, name):
    """Divides a run where the numbers of the column `name` change, and leaves the column out."""
    if name not in run.names:
        raise Refused(DATA, f'{run.path}: there is no column "{name}" (--runs); the columns are: '
                            f'{" ".join(run.names)[:255]}')
    at = run.names.index(name)
    number = run.value[:, at]
    starts = numpy.flatnonzero(numpy.concatenate(([True], number[1:] != number[:-1])))
    kept = [i for i in range(len(run.names)) if i != at]
    pieces = []
    for first, end in zip(starts, [*starts[1:], len(number)]):
        line = None if run.line is None else run.line[first:end]
        piece = Run(run.path, run.names, run.value[first:end], run.units, line, run.stamps)
        piece.keep_columns(kept)
        pieces.append(piece)
    return pieces
