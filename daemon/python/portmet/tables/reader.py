# SPDX-License-Identifier: MIT
"""Reads tables of any kind, and joins them to a dataset."""
import argparse
import contextlib
import glob
import os
import resource
import sys
import warnings

import h5py
import numpy

import lcm_log
import matlab
import portmet_files
import text
from table import MOST_COLUMNS, Refused, divide, drop_unnamed, refuse_repeated_names, say, take_times
from table import DATA, FILE

USAGE, MEMORY, INTERRUPTED = 2, 11, 12  # exit codes
EVEN = 0.01  # times that are off by less, in steps, are even: loggers round times
FOREIGN = {
    b"SQLite format 3": "this is a database, such as a bag of ROS 2, which holds no message types",
    b"\x89MCAP": "this is an MCAP file, such as a bag of ROS 2",
    b"#ROSBAG": "this is a bag of ROS",
    b"PK\x03\x04": "this is a spreadsheet or an archive",
    b"\xd0\xcf\x11\xe0": "this is an old spreadsheet",
}
TURNS = {"deg": 360.0, "degree": 360.0, "degrees": 360.0, "\u00b0": 360.0, "rad": 2 * numpy.pi, "mrad": 2e3 * numpy.pi}
WITHIN = 1.02  # turns: noise may lead out of one
NAMES_MOST = 60000  # bytes of an attribute
ROOM, TIMES_ROOM = 1 << 30, 100  # bytes of memory to read a binary file, and beyond that, times its size


@contextlib.contextmanager
def bounded(path):
    """Refuses a small file that declares gigabytes: reading it may take only so much memory more."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    with open("/proc/self/statm", encoding="ascii") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    size = os.path.getsize(path)
    limit = used + ROOM + TIMES_ROOM * size
    limits = [limit] + [other for other in (soft, hard) if other != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(limits), hard))
    try:
        yield
    except MemoryError:
        raise Refused(DATA, f"{path}: its {size} bytes declare more numbers than {(limit - used) >> 20} MiB hold") from None
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def read(path, how):
    """Reads a file of any kind as runs."""
    try:
        with open(path, "rb") as file:
            head = file.read(1024)
    except OSError as error:
        raise Refused(FILE, f"{path}: cannot be read: {error.strerror}") from None
    for begin, why in FOREIGN.items():
        if head.startswith(begin):
            raise Refused(DATA, f"{path}: {why}; save its tables as CSV")
    if head[:4] == lcm_log.SYNC.to_bytes(4, "big"):
        return lcm_log.read(path, types_of(how.types))
    with bounded(path):
        if head[:4] == b"PAR1":
            return portmet_files.read_parquet(path)
        if h5py.is_hdf5(path):
            reader = portmet_files.kind_of(path)
            return matlab.read(path, how.runs) if reader is None else reader(path)
        if head[:6] == b"MATLAB" or path.lower().endswith(".mat"):
            return matlab.read(path, how.runs)
        if head[:4] == b"\x89HDF":
            raise Refused(FILE, f"{path}: a damaged HDF5 file")
        run = text.read(path)
    return [run] if how.runs is None else divide(run, how.runs)


def files_of(paths):
    """Replaces folders by the files in them, in the order of their names."""
    result = []
    for path in paths:
        if not os.path.isdir(path):
            result.append(path)
            continue
        names = sorted(name for name in os.listdir(path) if not name.startswith(".") and os.path.isfile(os.path.join(path, name)))
        of_type = [name for name in names if name.lower().endswith((".csv", ".tsv", ".txt", ".dat", ".mat", ".parquet", ".csv.gz"))]
        if not of_type:
            raise Refused(FILE, f"{path}: the folder holds no table (.csv, .tsv, .txt, .dat, .mat, .parquet)")
        result += [os.path.join(path, name) for name in of_type]
    return result


def types_of(words):
    """Returns the files that --types names: FILE, FILE,FILE, or a folder of .lcm files."""
    names = [name for word in words for name in word.split(",")]
    return [path for name in names for path in
            (sorted(glob.glob(os.path.join(glob.escape(name), "*.lcm"))) if os.path.isdir(name) else [name])]


def units_of(given):
    """Returns the units by the names of columns that --units gives: NAME=UNIT,NAME=UNIT."""
    units = {}
    for pair in filter(None, (word.strip() for word in given.split(","))):
        name, _, unit = (word.strip() for word in pair.rpartition("="))
        if not name or not unit or name in units:
            raise Refused(USAGE, f'--units: expected NAME=UNIT once for each column, separated by commas, found "{pair[:80]}"')
        units[name] = unit
    return units


def set_units(run, units):
    for name, unit in units.items():
        if name not in run.names:
            raise Refused(DATA, f'{run.path}: there is no column "{name}" (--units); the columns are: {" ".join(run.names)[:255]}')
        run.units[run.names.index(name)] = unit


def clean(run, how):
    """Takes the times out, and missing samples; returns how many samples and rows were left out, and repeated."""
    drop_unnamed(run)
    refuse_repeated_names(run)
    set_units(run, how.units)
    marked = numpy.isin(run.value, how.missing) if how.missing else numpy.zeros(0, dtype=bool)
    if marked.any():
        run.value[marked] = numpy.nan
    without, repeated = take_times(run, how.time, how.dt)
    if not run.names:
        raise Refused(DATA, f"{run.path}: there is no column of numbers beside the times")
    if len(run.time) < 2:
        raise Refused(DATA, f"{run.path}: {len(run.time)} rows of numbers, expected two or more")
    if numpy.isinf(run.value).any():
        row, column = numpy.argwhere(numpy.isinf(run.value))[0]
        raise Refused(DATA, f'{run.at(row)}: column "{run.names[column]}" is infinite')
    return int(marked.sum()), without, repeated


def positive(word):
    value = float(word)
    if not 0 < value < float("inf"):
        raise ValueError
    return value


def align(run, first):
    """Puts the columns into the order of the first run."""
    if sorted(run.names) != sorted(first.names):
        missing = [name for name in first.names if name not in run.names]
        more = [name for name in run.names if name not in first.names]
        raise Refused(DATA, f"{run.path}: expected the same columns as in {first.path}; "
                            + "; ".join(f"{what} {' '.join(names)[:100]}" for what, names in (("without", missing), ("with", more)) if names))
    run.keep_columns([run.names.index(name) for name in first.names])
    for name, unit, other in zip(run.names, run.units, first.units):
        if unit != other:
            raise Refused(DATA, f'{run.path}: column "{name}" is in "{unit}", expected "{other}", in the same units as in {first.path}')


def even_times(times):
    """Returns the times of all runs on even grids, and the step dt, if those of all runs are even with the same step;
    otherwise the times as they are, and the median step."""
    longest = max(times, key=len)
    dt = (longest[-1] - longest[0]) / (len(longest) - 1)
    for step in (float(f"{dt:.9g}"), dt):  # 0.01 instead of 0.010000000000000009
        grids = [time[0] + step * numpy.arange(len(time)) for time in times]
        if all((numpy.abs(time - grid) <= EVEN * step).all() for time, grid in zip(times, grids)):
            return grids, step
    return times, float(f"{numpy.median(numpy.concatenate([numpy.diff(time) for time in times])):.9g}")


def unwrap(runs):
    """Joins angles that a sensor shows within one turn, at whose end they jump: all are within a turn, and some change by
    more than half of it from sample to sample. Returns the names of their columns."""
    names = []
    for c, (name, unit) in enumerate(zip(runs[0].names, runs[0].units)):
        turn = TURNS.get(unit.strip().lower())
        columns = [run.value[numpy.isfinite(run.value[:, c]), c] for run in runs]
        columns = [column for column in columns if len(column) > 1]
        if turn is None or not columns:
            continue
        span = max(column.max() for column in columns) - min(column.min() for column in columns)
        if span <= WITHIN * turn and max(abs(numpy.diff(column)).max() for column in columns) > turn / 2:
            names.append(name)
            for run in runs:
                there = numpy.isfinite(run.value[:, c])
                run.value[there, c] = numpy.unwrap(run.value[there, c], period=turn)
    return names


def join(words):
    parser = argparse.ArgumentParser(prog="tables")
    parser.add_argument("output")
    for name in ("--time", "--runs"):
        parser.add_argument(name)
    parser.add_argument("--dt", type=positive)
    parser.add_argument("--missing", default="")
    parser.add_argument("--types", action="append", default=[])
    parser.add_argument("--units", default="")
    parser.add_argument("--temporary", action="store_true", help="nobody asked for the dataset by its name")
    parser.add_argument("tables", nargs="+")
    how = parser.parse_args(words)
    given = [word.strip() for word in how.missing.split(",") if word.strip()]
    how.missing = [float(word) for word in given if text.NUMBER.fullmatch(word)]
    how.units = units_of(how.units)
    text.set_missing(word for word in given if not text.NUMBER.fullmatch(word))
    runs, counts = [], numpy.zeros(3, dtype=int)
    paths = files_of(how.tables)
    for path in paths:
        if os.path.exists(how.output) and os.path.exists(path) and os.path.samefile(how.output, path):
            raise Refused(USAGE, f"{how.output}: the program reads this file, and does not overwrite it")
    for path in paths:
        found = read(path, how)
        for run in found:
            if len(found) > 1 and len(run.value) < 2:
                say(f"{run.path}: leaves out this run, which has {len(run.value)} row{'' if len(run.value) == 1 else 's'}")
                continue
            counts += clean(run, how)
            if runs:
                align(run, runs[0])
            runs.append(run)
    if not runs:
        raise Refused(DATA, f"{how.tables[0]}: there is no run of two or more rows")
    for count, what in zip(counts, ("samples that --missing names are missing samples", "rows without a time are left out",
                                    "rows that repeat a time are left out: the first ones count")):
        if count:
            say(f"{count} {what}")
    for name in unwrap(runs):
        say(f"{name} jumps at the end of a turn: its turns are joined")
    times = [run.time for run in runs]
    if any(time[0] != times[0][0] for time in times) or abs(times[0][0]) > 1e8:
        say("each trajectory begins at the time 0")
        times = [time - time[0] for time in times]
    write(how.output, runs, times, how.temporary)


def write(path, runs, times, temporary=False):
    ntime, first = max(map(len, times)), runs[0]
    z = numpy.full((len(runs), ntime, len(first.names)), numpy.nan)
    grids, dt = even_times(times)
    if grids is not times and all(numpy.array_equal(grid, grids[0]) for grid in grids):
        t = grids[0]
    else:
        t = numpy.full((len(runs), ntime), numpy.nan)
        for i, time in enumerate(grids):
            t[i, :len(time)] = time
    for i, run in enumerate(runs):
        z[i, :len(run.value)] = run.value
    layout = " ".join(first.names)
    if len(layout.encode()) > NAMES_MOST or len(first.names) > MOST_COLUMNS:
        raise Refused(DATA, f"{first.path}: the names of {len(first.names)} columns are too long")
    part = f"{path}.{os.getpid()}.part"
    try:
        with h5py.File(part, "w") as file:
            file["z"], file["t"], file["dt"] = z, t, dt
            file["t"].attrs["units"] = file["dt"].attrs["units"] = numpy.bytes_("s")
            file["z"].attrs["description"] = numpy.bytes_("[trajectory][time][column]")
            file.attrs["state_layout"] = numpy.bytes_(layout.encode())
            file.attrs["units"] = numpy.bytes_(";".join(unit.replace(";", ",") for unit in first.units).encode())
            file.attrs["source"] = numpy.bytes_("portmet-train import")
        os.replace(part, path)
    except OSError as error:
        raise Refused(FILE, f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        if os.path.exists(part):
            os.unlink(part)
    what = "1 trajectory" if len(runs) == 1 else f"{len(runs)} trajectories"
    say(f"{'tables' if temporary else 'wrote ' + path}: {what} of at most {ntime} samples, columns {layout}")


def main(words):
    """Returns the exit code; a failure is one line on standard error."""
    warnings.simplefilter("ignore")  # standard error has one line, or none
    try:
        join(words)
        return 0
    except Refused as error:
        code, why = error.code, error
    except MemoryError:
        code, why = MEMORY, "out of memory for the tables"
    except KeyboardInterrupt:
        code, why = INTERRUPTED, "interrupted"
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code, why = FILE, "standard output is closed"
    except Exception as error:  # a file of which no reader thought
        code, why = DATA, f"a table cannot be read: {type(error).__name__}: {error}"
    print("portmet-train: " + " ".join(str(why).split()), file=sys.stderr)
    return code
