"""The HDF5 files of portmet as objects: datasets, recordings and weights."""
import collections
import re

import h5py
import numpy

from ._library import UsageError


def _text(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def _expand(names):
    """Returns the names that a list such as "s f[0:3]" means: s, f0, f1, f2."""
    result = []
    for word in names.split():
        range_ = re.fullmatch(r"(.*)\[(\d+):(\d+)\]", word)
        result += [f"{range_[1]}{i}" for i in range(int(range_[2]), int(range_[3]))] if range_ else [word]
    return result


class Dataset:
    """Trajectories: z [trajectory][time][column], t [time] (s), dt (s), the names of the columns, the
    rates zdot or None, and notes (trainer/DATASET.md)."""

    def __init__(self, path=None, *, z=None, dt=None, columns=None, zdot=None, units=None, notes=()):
        if path is None:
            self.z = numpy.array(z, dtype=float, ndmin=3)
            self.zdot = None if zdot is None else numpy.array(zdot, dtype=float, ndmin=3)
            self.dt, self.columns, self.units = float(dt), list(columns), units
            self.t = numpy.arange(self.z.shape[1]) * self.dt
            self.notes = dict(notes)
            return
        with h5py.File(path, "r") as f:
            self.z, self.t, self.dt = f["z"][:], f["t"][:], float(f["dt"][()])
            self.zdot = f["zdot"][:] if "zdot" in f else None
            notes = {name: _text(value) for name, value in f.attrs.items()}
        self.columns = _expand(notes.pop("state_layout"))
        self.units = notes.pop("units").split(";") if "units" in notes else None
        self.notes = notes

    def __getitem__(self, column):
        """Returns one column of all trajectories: [trajectory][time]."""
        return self.z[:, :, self.columns.index(column)]

    def save(self, path):
        """Writes the dataset, for `fit`, `evaluate` or a scene's reference."""
        if self.z.shape[2] != len(self.columns):
            raise UsageError(f"{self.z.shape[2]} columns, and {len(self.columns)} names")
        with h5py.File(path, "w") as f:
            f["z"], f["t"], f["dt"] = self.z, self.t, self.dt
            if self.zdot is not None:
                f["zdot"] = self.zdot
            f.attrs["state_layout"] = numpy.bytes_(" ".join(self.columns))
            if self.units is not None:
                f.attrs["units"] = numpy.bytes_(";".join(self.units))
            for name, text in self.notes.items():
                f.attrs[name] = numpy.bytes_(str(text))


class Recording:
    """What --record or Scene.record wrote: time (s) and step [sample]; subsystems[name] and
    ports[name] map the names of daemon/README.md, "Recordings", to arrays [sample]; so does ledger.
    Subsystems that the scene names by a range, "link[0:9]", are together, and the arrays have
    another axis, for the members: E [sample][member]."""

    def __init__(self, path):
        with h5py.File(path, "r") as f:
            count = int(f.attrs["committed"])  # a killed run leaves more rows in some series
            self.time, self.step = f["time"][:count], f["step"][:count]
            self.subsystems, self.ports = ({name: {key: data[:count] for key, data in group.items()}
                                            for name, group in f.get(kind, {}).items()}
                                           for kind in ("subsystems", "ports"))
            self.ledger = {key: data[:count] for key, data in f["ledger"].items()}


Group = collections.namedtuple("Group", "name size unit")


class Weights:
    """A weights file: `kind` ("subsystem" or "port"), the text of its `model`, its `parameters` by name,
    its `layout` (of a port a list for each end), and `made`, where it comes from."""

    def __init__(self, path):
        with h5py.File(path, "r") as f:
            self.made = {name: _text(v) if isinstance(v, (bytes, str)) else v for name, v in f.attrs.items()}
            self.kind, self.model = self.made.pop("kind"), self.made.pop("model")
            self.parameters = {name: data[:] for name, data in f.get("parameters", {}).items()}
            self.trained = {name for name in self.parameters if f["parameters"][name].attrs["trained"]}
            ends = [self._layout(f[name]) for name in ("layout", "layout_a", "layout_b") if name in f]
        self.layout = ends[0] if self.kind == "subsystem" else ends

    @staticmethod
    def _layout(group):
        names, units, sizes = (group.attrs[key] for key in ("names", "units", "sizes"))
        return [Group(_text(n), int(s), _text(u)) for n, u, s in zip(names, units, sizes)]
