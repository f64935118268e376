# SPDX-License-Identifier: MIT
"""The HDF5 files of portmet itself as tables: datasets, recordings of runs, predictions; and Parquet files."""
import re

import h5py
import numpy

from table import DATA, FILE, Refused, Run, say


def text(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def expand(names):
    """Returns the names that a list such as "s f[0:3]" means: s, f0, f1, f2."""
    result = []
    for word in names.split():
        span = re.fullmatch(r"(.*)\[(\d+):(\d+)\](.*)", word)
        result += [f"{span[1]}{i}{span[4]}" for i in range(int(span[2]), int(span[3]))] if span else [word]
    return result


def kind_of(path):
    """Returns the reader of an HDF5 file that portmet has written, or None."""
    with h5py.File(path, "r") as file:
        if "state_layout" in file.attrs and "z" in file and "t" in file:
            return read_dataset
        if "committed" in file.attrs and "time" in file and "subsystems" in file:
            return read_recording
    return None


def read_dataset(path):
    """Reads the trajectories of a dataset as runs."""
    with h5py.File(path, "r") as file:
        z, t = file["z"][()], file["t"][()]
        names = expand(text(file.attrs["state_layout"]))
        units = text(file.attrs["units"]).split(";") if "units" in file.attrs else None
    if z.ndim != 3 or z.shape[2] != len(names) or t.shape[-1] != z.shape[1] or (units and len(units) != len(names)):
        raise Refused(DATA, f"{path}: z, t, state_layout and units of the dataset have different lengths")
    runs = []
    for i, rows in enumerate(z):
        time = t if t.ndim == 1 else t[i]
        there = numpy.isfinite(time)
        runs.append(Run(f"{path}: trajectory {i}", ["t", *names], numpy.column_stack((time, rows))[there],
                        ["s", *(units or [""] * len(names))]))
    return runs


def read_recording(path):
    """Reads the states and the live inputs of a recorded run. The columns are SUBSYSTEM.GROUP, of several components
    SUBSYSTEM.GROUP_0, SUBSYSTEM.GROUP_1, ..."""
    with h5py.File(path, "r") as file:
        count = int(file.attrs["committed"])
        names, units, columns = ["t"], ["s"], [file["time"][:count]]
        for family, group in file["subsystems"].items():
            z = group["z"][:count].reshape(count, -1)
            own = expand(" ".join(map(text, numpy.atleast_1d(group["z"].attrs["variables"]))))
            own_units = list(map(text, numpy.atleast_1d(group["z"].attrs["units"])))
            own = [re.sub(r"\[(\d+)\]", r"_\1", name) for name in own]
            members = expand(family)
            if len(own) * len(members) != z.shape[1] or len(own_units) != len(own):
                say(f"{path}: leaves out {family}, whose {z.shape[1]} variables have no names of their own")
                continue
            names += [f"{member}.{name}" for member in members for name in own]
            units += own_units * len(members)
            columns += list(z.T)
        for name, values in file.get("live", {}).items():
            names, units, columns = [*names, name], [*units, ""], [*columns, values[:count]]
    return [Run(path, names, numpy.array(columns, dtype=float).T, units)]


def read_parquet(path):
    """Reads the columns of numbers and of times of a Parquet file, where pyarrow or fastparquet is installed."""
    try:
        import pyarrow.parquet
        table = pyarrow.parquet.read_table(path)
        arrays = {name: table.column(name).to_numpy() for name in table.column_names}
    except ImportError:
        try:
            import fastparquet
            frame = fastparquet.ParquetFile(path).to_pandas()
            arrays = {name: frame[name].to_numpy() for name in frame.columns}
        except ImportError:
            raise Refused(FILE, f"{path}: Parquet needs pyarrow or fastparquet, which are not installed and no packages of "
                                "Debian 12: pip install pyarrow, or save the table as CSV") from None
    names, columns, times = [], [], []
    for name, values in arrays.items():
        values = numpy.asarray(values)
        if values.dtype.kind == "M":
            since = values.astype("datetime64[ns]")
            there = ~numpy.isnat(since)
            column = numpy.full(len(since), numpy.nan)
            column[there] = (since[there] - since[there][:1]).astype(float) * 1e-9
            times.append(name)
        elif values.dtype.kind in "fiub":
            column = values.astype(float)
        else:
            say(f'{path}: leaves out column "{name}", which holds no numbers')
            continue
        names.append(re.sub(r"\s+", "_", str(name).strip()))
        columns.append(column)
    if not names:
        raise Refused(DATA, f"{path}: there is no column of numbers")
    return [Run(path, names, numpy.array(columns).T, stamps=times)]
