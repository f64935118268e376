# SPDX-License-Identifier: MIT
"""MATLAB files of all versions, and HDF5 files: variables and structs become columns, arrays of structs become runs."""
import h5py
import numpy

from table import DATA, FILE, Refused, Run, is_time_name, say

STEP_NAMES = {"dt": 1, "ts": 1, "tsample": 1, "sampletime": 1, "samplingtime": 1, "sample_time": 1, "sampling_time": 1}
RATE_NAMES = ("fs", "samplerate", "sample_rate", "samplingrate", "sampling_rate", "samplingfrequency")


# --- files become trees: dicts (structs), lists (arrays of structs, cells), arrays of numbers, None (anything else) ---

def _tree_of_scipy(value):
    if type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):  # tables, objects
        return None
    if isinstance(value, numpy.ndarray) and value.dtype.names:
        found = [{name: _tree_of_scipy(element[name]) for name in value.dtype.names} for element in value.flat]
        return found[0] if len(found) == 1 else found
    if isinstance(value, numpy.ndarray) and value.dtype == object:
        found = [_tree_of_scipy(element) for element in value.flat]
        return found[0] if len(found) == 1 else found
    if isinstance(value, numpy.ndarray) and value.dtype.kind in "fiub":
        return value.astype(float)
    return None


def _tree_of_hdf5(node, file, transpose):
    if isinstance(node, h5py.Group):
        fields = {name: _tree_of_hdf5(child, file, transpose) for name, child in node.items() if not name.startswith("#")}
        lengths = {len(field) for field in fields.values() if isinstance(field, _References)}
        if fields and len(lengths) == 1 and all(isinstance(field, _References) for field in fields.values()):
            return [{name: field[i] for name, field in fields.items()} for i in range(lengths.pop())]
        return fields
    if h5py.check_ref_dtype(node.dtype) is h5py.Reference:
        found = _References(_tree_of_hdf5(file[reference], file, transpose) for reference in node[()].flat if reference)
        return found
    if node.attrs.get("MATLAB_class", b"") in (b"char", "char") or node.dtype.kind not in "fiub":
        return None
    if "MATLAB_empty" in node.attrs or node.shape is None:
        return numpy.zeros((0, 0))
    value = node[()].astype(float)
    return value.T if transpose and value.ndim > 1 else value


class _References(list):
    """Elements to which an array of a MATLAB file refers: a cell, or one field of an array of structs."""


def read_tree(path):
    """Returns the tree of a MATLAB file, or of an HDF5 file."""
    if h5py.is_hdf5(path):
        with h5py.File(path, "r") as file:
            with open(path, "rb") as text:
                matlab = text.read(6) == b"MATLAB"
            return _tree_of_hdf5(file, file, matlab)
    try:
        import scipy.io  # takes half a second, which other tables need not wait
    except ImportError:
        raise Refused(FILE, f"{path}: MATLAB files need scipy: apt-get install python3-scipy") from None
    try:
        variables = scipy.io.loadmat(path)
    except OSError as error:
        raise Refused(FILE, f"{path}: cannot be read: {error.strerror or error}") from None
    except MemoryError:
        raise
    except Exception as error:  # scipy raises many kinds
        text = " ".join(str(error).split())
        raise Refused(FILE, f"{path}: cannot be read as a MATLAB file: {text[:200]}") from None
    return {name: _tree_of_scipy(value) for name, value in variables.items() if not name.startswith("__")}


# --- trees become runs ---

def _leaves(tree, prefix=""):
    """Yields the path, the name and the array of all numbers of a struct and the structs in it."""
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{name}.")
        elif isinstance(value, numpy.ndarray):
            yield prefix + name, name, value
        else:
            yield prefix + name, name, None


def _has_samples(tree):
    return isinstance(tree, dict) and any(value is not None and max(value.shape, default=0) > 1 for _, _, value in _leaves(tree))


def _collections(tree, prefix=""):
    """Yields the path and the structs of each array of structs, and of structs side by side with the same fields."""
    for name, value in tree.items():
        if isinstance(value, list):
            structs = [{name: element} if isinstance(element, numpy.ndarray) else element for element in value]
            structs = [element for element in structs if _has_samples(element)]
            if structs:
                yield prefix + name, structs
        elif isinstance(value, dict):
            yield from _collections(value, f"{prefix}{name}.")
    structs = {name: value for name, value in tree.items() if _has_samples(value)}
    if len(structs) > 1 and len({tuple(sorted(value)) for value in structs.values()}) == 1:
        yield prefix.rstrip("."), list(structs.values())


def _run_of(tree, path, left_out):
    """Makes a run of a struct: vectors are columns, and so are those of a matrix x: x_1, x_2, ... Samples are the rows
    of a matrix, or its columns if only these are as many as the longest vector has samples."""
    leaves = list(_leaves(tree))
    count = max((max(value.shape, default=0) for _, _, value in leaves if value is not None and value.ndim <= 2), default=0)
    names = [name for _, name, _ in leaves]
    columns, step = {}, None
    for place, name, value in leaves:
        own = name if names.count(name) == 1 else place
        if value is None or value.ndim > 2 or count < 2 or count not in value.shape:
            if value is not None and value.size == 1:
                number = float(value.flat[0])
                key = name.lower()
                step = number if key in STEP_NAMES and number > 0 else 1 / number if key in RATE_NAMES and number > 0 else step
            left_out.setdefault(place, "no real numbers" if value is None else
                                f"{' x '.join(map(str, value.shape))}, where the longest has {count} samples")
            continue
        matrix = value.reshape(count, -1) if value.ndim < 2 or value.shape[0] == count else value.T
        for i, column in enumerate(matrix.T):
            columns[own if matrix.shape[1] == 1 else f"{own}_{i + 1}"] = column
    run = Run(path, columns, numpy.array(list(columns.values())).T if columns else numpy.zeros((0, 0)))
    if step is not None and columns and not any(map(is_time_name, columns)):
        run.names, run.units = ["t"] + run.names, ["s"] + run.units
        run.value = numpy.column_stack((step * numpy.arange(count), run.value))
        left_out.pop(next(place for place, name, _ in leaves if name.lower() in (*STEP_NAMES, *RATE_NAMES)), None)
    return run


def read(path, wanted):
    """Reads a file as runs. `wanted` is the name of an array of structs, or None: the only one is taken, unless
    there are times beside it."""
    tree = read_tree(path)
    found = dict(_collections(tree))
    beside = {name: value for name, value in tree.items() if isinstance(value, numpy.ndarray)}
    chosen = None
    if wanted is not None:
        same = [place for place in found if wanted in (place, place.rsplit(".", 1)[-1])]
        if not same:
            raise Refused(DATA, f'{path}: there is no array of structs "{wanted}"'
                                + (f"; there are: {' '.join(found)[:255]}" if found else ""))
        chosen = same[0]
    elif found and not any(map(is_time_name, beside)):
        if len(found) > 1:
            listed = ", ".join(f"{place} ({len(structs)})" for place, structs in found.items())
            raise Refused(DATA, f"{path}: several arrays of structs: {listed[:255]}; choose one with --runs")
        chosen = next(iter(found))
    left_out = {}
    if chosen is None:
        runs = [_run_of(tree, path, left_out)]
    else:
        runs = [_run_of(struct, f"{path}: {chosen or 'structs'}({i + 1})", left_out) for i, struct in enumerate(found[chosen])]
    for name, why in left_out.items():
        say(f"{path}: leaves out {name}, {why}")
    empty = [run for run in runs if not run.names]
    runs = [run for run in runs if run.names]
    if not runs:
        raise Refused(DATA, f"{path}: there is no column of numbers")
    if empty:
        say(f"{path}: leaves out {len(empty)} run{'' if len(empty) == 1 else 's'} without samples, such as {empty[0].path}")
    _fill(runs)
    return runs


def _fill(runs):
    """Gives all runs of a file the same columns: NaN where a field of a struct is empty."""
    names = dict.fromkeys(name for run in runs for name in run.names)
    for run in runs:
        missing = [name for name in names if name not in run.names]
        run.value = numpy.column_stack([run.value, *(numpy.full(len(run.value), numpy.nan) for _ in missing)])
        run.names, run.units = run.names + missing, run.units + [""] * len(missing)
