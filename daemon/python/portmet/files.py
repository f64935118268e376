# SPDX-License-Identifier: MIT
"""The HDF5 files of portmet as objects: datasets, recordings and weights."""
from __future__ import annotations

import contextlib
import os
import re
import typing

import h5py
import numpy

from ._library import Error, UnknownName, UsageError, path_bytes, public

if typing.TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray
    Numbers = NDArray[numpy.float64]
    Path = typing.Union[str, os.PathLike[str]]


def _check_output(path: Path) -> None:
    """Raises Error if there is something that no dataset replaces (daemon/base/files.h)."""
    start, place = b"", os.fsencode(path)
    if os.path.islink(place):
        raise Error(4, f"{os.fspath(path)}: this is a symbolic link, and is not replaced")
    if os.path.exists(place) and not os.path.isfile(place):
        raise Error(4, f"{os.fspath(path)}: this is not a regular file, and is not replaced")
    if os.path.isfile(place):
        with contextlib.suppress(OSError), open(place, "rb") as f:
            start = f.read(16384)
    if start and (not start.startswith(b"\x89HDF\r\n\x1a\n") or b"portmet weights" in start or b"portmet recording" in start):
        raise Error(4, f"{os.fspath(path)}: this file exists and is of another kind: remove it, or choose another name")


@contextlib.contextmanager
def _open(path: Path, what: str, mode: str = "r") -> typing.Iterator[typing.Any]:
    """Opens an HDF5 file, and says in an Error if it cannot be read or written, or is of another kind."""
    path_bytes(path)  # not a number, which would be an open file
    try:
        with h5py.File(path, mode) as f:
            yield f
    except OSError as error:
        raise Error(4, f"{os.fspath(path)}: {error}") from None
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise Error(4, f"{os.fspath(path)}: this is not {what}: {error}") from None


def _text(value: typing.Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _expand(names: str) -> list[str]:
    """Returns the names that a list such as "s f[0:3]" means: s, f0, f1, f2."""
    result = []
    for word in names.split():
        range_ = re.fullmatch(r"(.*)\[(\d+):(\d+)\]", word)
        result += [f"{range_[1]}{i}" for i in range(int(range_[2]), int(range_[3]))] if range_ else [word]
    return result


@public
class Dataset:
    """Trajectories: z [trajectory][time][column], t [time] or [trajectory][time] (s), dt (s; NaN: the times
    are uneven), the names of the columns, the rates zdot or None, and notes (trainer/DATASET.md)."""

    def __init__(self, path: Path | None = None, *, z: ArrayLike | None = None, dt: float | None = None,
                 columns: typing.Iterable[str] | None = None, zdot: ArrayLike | None = None,
                 units: list[str] | None = None, notes: typing.Any = ()) -> None:
        self._file: os.stat_result | None = None  # from which it was read
        if path is None:
            if z is None or dt is None or columns is None:
                raise UsageError("a dataset needs either a path or z, dt and columns")
            self.z: Numbers = numpy.array(z, dtype=float, ndmin=3)
            self.zdot: Numbers | None = None if zdot is None else numpy.array(zdot, dtype=float, ndmin=3)
            self.dt, self.columns, self.units = float(dt), list(columns), units
            self.t: Numbers = numpy.arange(self.z.shape[1]) * self.dt
            self.notes = dict(notes)
            return
        with _open(path, "a dataset") as f:
            self._file = os.stat(path)
            self.z, self.t, self.dt = f["z"][:], f["t"][:], float(f["dt"][()]) if "dt" in f else numpy.nan
            self.zdot = f["zdot"][:] if "zdot" in f else None
            notes = {name: _text(value) for name, value in f.attrs.items()}
        self.columns = _expand(notes.pop("state_layout"))
        self.units = notes.pop("units").split(";") if "units" in notes else None
        self.notes = notes

    def __getitem__(self, column: str) -> Numbers:
        """Returns one column of all trajectories: [trajectory][time]."""
        if column not in self.columns:
            raise UnknownName(f"the dataset has no column {column!r}; there are: {', '.join(self.columns)}")
        return self.z[:, :, self.columns.index(column)]

    def __iter__(self) -> typing.Iterator[str]:
        return iter(self.columns)

    def __contains__(self, column: object) -> bool:
        return column in self.columns

    def __len__(self) -> int:
        return len(self.columns)

    def __repr__(self) -> str:
        return f"<portmet dataset: {len(self.z)} trajectories of {len(self.t)} states; {', '.join(self.columns[:8])}>"

    def save(self, path: Path) -> None:
        """Writes the dataset, for `fit`, `evaluate` or a scene's reference, but not to the file from which it was read."""
        if self._file is not None and os.path.exists(path) and os.path.samestat(self._file, os.stat(path)):
            raise UsageError(f"{os.fspath(path)}: the dataset was read from this file, and does not overwrite it")
        _check_output(path)
        if self.z.shape[2] != len(self.columns):
            raise UsageError(f"{self.z.shape[2]} columns, and {len(self.columns)} names")
        with _open(path, "a dataset", "w") as f:
            f["z"], f["t"] = self.z, self.t
            if not numpy.isnan(self.dt):
                f["dt"] = self.dt
            if self.zdot is not None:
                f["zdot"] = self.zdot
            f.attrs["state_layout"] = numpy.bytes_(" ".join(self.columns))
            if self.units is not None:
                f.attrs["units"] = numpy.bytes_(";".join(self.units))
            for name, text in self.notes.items():
                f.attrs[name] = numpy.bytes_(str(text))

    def to_dataframe(self) -> typing.Any:
        """Returns a pandas DataFrame with the index (trajectory, time)."""
        import pandas

        trajectory = numpy.repeat(numpy.arange(len(self.z)), self.z.shape[1])
        index = pandas.MultiIndex.from_arrays([trajectory, numpy.broadcast_to(self.t, self.z.shape[:2]).ravel()],
                                              names=["trajectory", "time"])
        return pandas.DataFrame(self.z.reshape(-1, self.z.shape[2]), index, self.columns)

    def to_xarray(self) -> typing.Any:
        """Returns an xarray Dataset with the dimensions trajectory and time, and units as attributes."""
        import xarray

        units = self.units or [""] * len(self.columns)
        times: typing.Any = {"time": ("time", self.t, {"units": "s"})}
        if self.t.ndim == 2:
            times = {"t": (("trajectory", "time"), self.t, {"units": "s"})}
        return xarray.Dataset({name: (("trajectory", "time"), self[name], {"units": unit} if unit else {})
                               for name, unit in zip(self.columns, units)}, times)


@public
class Recording:
    """What --record or Scene.record wrote: time (s) and step [sample]; subsystems[name] and
    ports[name] map the names of daemon/README.md, "Recordings", to arrays [sample]; so does ledger.
    variables[name] are the names of the columns of a subsystem's z, and `ends` [name] what is at the
    ends of a port. Subsystems that the scene names by a range, "link[0:9]", are together, and the
    arrays have another axis, for the members: E [sample][member]. `series` has every number by a name
    of its own: series["upper.q[0]"], series["link3.E"], series["joint.energy_flux_a"]; and `units`
    has its unit."""

    def __init__(self, path: Path) -> None:
        self.series: dict[str, Numbers] = {}
        self.units: dict[str, str] = {}
        with _open(path, "a recording") as f:
            count = int(f.attrs["committed"])  # a killed run leaves more rows in some series
            self.scene = _text(f.attrs["scene"])
            self.time: Numbers = f["time"][:count]
            self.step: NDArray[numpy.int64] = f["step"][:count]
            groups = {kind: f.get(kind, {}) for kind in ("subsystems", "ports")}
            self.variables = {name: [_text(v) for v in group["z"].attrs["variables"]]
                              for name, group in groups["subsystems"].items() if "z" in group}
            self.ends = {name: [_text(v) for v in group.attrs["ends"]] for name, group in groups["ports"].items()
                         if "ends" in group.attrs}
            self.subsystems, self.ports = ({name: self._read(name, group, count) for name, group in groups[kind].items()}
                                           for kind in ("subsystems", "ports"))
            self.ledger = self._read("ledger", f["ledger"], count)

    def _read(self, owner: str, group: typing.Any, count: int) -> dict[str, Numbers]:
        """Reads the series of one owner, and gives each column a name of its own."""
        result: dict[str, Numbers] = {key: data[:count] for key, data in group.items()}
        members = _expand(owner)
        for key, values in result.items():
            units = group[key].attrs.get("units", b"")
            columns, names = values.reshape(count, len(members), -1), [key]
            if key == "z":
                # As Scene.variables has them: a lone component is "s[0]".
                names = [n if "[" in n else n + "[0]" for n in self.variables[owner]]
                if len(names) != columns.shape[2]:  # groups: "q[0:5000]"
                    names = [f"{name}[{i}]" for name, first, last in (
                        re.fullmatch(r"(.*)\[(\d+):(\d+)\]", n).groups() for n in names)  # type: ignore[union-attr]
                        for i in range(int(first), int(last))]
            every = [units] * len(names) if isinstance(units, (bytes, str)) else list(units)
            if len(every) != len(names):
                every = [""] * len(names)
            for m, member in enumerate(members):
                for c, name in enumerate(names):
                    self.series[f"{member}.{name}"] = columns[:, m, c]
                    self.units[f"{member}.{name}"] = _text(every[c])
        return result

    def __getitem__(self, name: str) -> Numbers:
        if name not in self.series:
            raise UnknownName(f"the recording has no {name!r}; list(recording) has all names")
        return self.series[name]

    def __iter__(self) -> typing.Iterator[str]:
        return iter(self.series)

    def __contains__(self, name: object) -> bool:
        return name in self.series

    def __len__(self) -> int:
        return len(self.series)

    def __repr__(self) -> str:
        return f"<portmet recording of {self.scene}: {len(self.time)} samples; {', '.join(self.subsystems)}>"

    def to_dataframe(self) -> typing.Any:
        """Returns a pandas DataFrame of all series, with the time as index; its attrs has the units."""
        import pandas

        frame = pandas.DataFrame(self.series, pandas.Index(self.time, name="time"))
        frame.attrs["units"] = self.units
        return frame

    def to_xarray(self) -> typing.Any:
        """Returns an xarray Dataset of all series over the time, with units as attributes."""
        import xarray

        return xarray.Dataset({name: ("time", values, {"units": self.units[name]}) for name, values in self.series.items()},
                              {"time": ("time", self.time, {"units": "s"})}, {"scene": self.scene})

    def plot(self, path: Path | None = None) -> Figure:
        """Draws energies, entropies and powers over time, as portmet.plot does."""
        from .plot import plot

        return plot(self, path)


class Group(typing.NamedTuple):
    """A group of variables."""
    name: str
    size: int
    unit: str


@public
class Weights:
    """A weights file: `kind` ("subsystem" or "port"), the text of its `model`, its `parameters` by name,
    its `layout` (of a port a list for each end), and `made`, where it comes from."""

    layout: list[typing.Any]

    def __init__(self, path: Path) -> None:
        with _open(path, "a weights file") as f:
            self.made: dict[str, typing.Any] = {name: _text(v) if isinstance(v, (bytes, str)) else v for name, v in f.attrs.items()}
            self.kind, self.model = self.made.pop("kind"), self.made.pop("model")
            self.parameters: dict[str, Numbers] = {name: data[:] for name, data in f.get("parameters", {}).items()}
            self.trained = {name for name in self.parameters if f["parameters"][name].attrs["trained"]}
            ends: list[typing.Any] = [self._layout(f[name]) for name in ("layout", "layout_a", "layout_b") if name in f]
        self.layout = ends[0] if self.kind == "subsystem" else ends

    @property
    def verdict(self) -> str:
        """What the fit said at its end: "good", or another word with its reasons behind a colon."""
        return str(self.made.get("verdict", ""))

    @property
    def constants(self) -> dict[str, float]:
        """The learned constants of the model, by their names."""
        result = {}
        for name, value in self.parameters.items():
            if name.startswith("constant."):
                name = name[len("constant."):]
                # Of a positive constant training moves the logarithm.
                positive = re.search(rf"\b{re.escape(name)}\s*:\s*{{[^}}]*positive\s*:\s*true", self.model)
                result[name] = float(numpy.exp(value.flat[0]) if positive else value.flat[0])
        return result

    @staticmethod
    def _layout(group: typing.Any) -> list[Group]:
        names, units, sizes = (group.attrs[key] for key in ("names", "units", "sizes"))
        return [Group(_text(n), int(s), _text(u)) for n, u, s in zip(names, units, sizes)]
