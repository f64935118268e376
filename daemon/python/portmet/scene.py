# SPDX-License-Identifier: MIT
"""Scenes and parts to step in this process."""
from __future__ import annotations

import collections.abc
import ctypes
import os
import re
import time
import typing

import numpy

if typing.TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from typing_extensions import Self

    from .files import Group
    Numbers = NDArray[numpy.float64]

from . import _library as c
from .files import Dataset, Weights


class _Handle:
    """The scene in libportmet. It is closed when neither the Scene nor any of its arrays is in use."""

    def __init__(self, pointer: ctypes.c_void_p) -> None:
        self.pointer = pointer

    def __del__(self) -> None:
        c.library.portmet_scene_close(self.pointer)

    def array(self, address: int | None, size: int, writable: bool = False, kind: typing.Any = float) -> typing.Any:
        """Returns the `size` numbers at `address` as a numpy array that keeps the scene open."""
        if not address:
            return numpy.empty(0)
        memory = (numpy.ctypeslib.as_ctypes_type(kind) * size).from_address(address)
        memory.handle = self
        array = numpy.frombuffer(memory, kind)
        array.flags.writeable = writable
        return array

    def names(self, kind: int) -> list[str]:
        result: list[str] = []
        while (name := c.library.portmet_scene_name(self.pointer, kind, len(result))) is not None:
            result.append(name.decode())
        return result


def _groups(names: list[str]) -> dict[str, slice]:
    """Returns {group: slice} for the names "owner.group[i]" of one owner, which begin at 0."""
    result: dict[str, slice] = {}
    for i, name in enumerate(names):
        group = re.fullmatch(r"[^.]*\.(.*)\[\d+\]", name)[1]  # type: ignore[index]
        first = result[group].start if group in result else i
        result[group] = slice(first, i + 1)
    return result


class Ledger:
    """Both laws over the steps so far. Its members follow every step; repr() lists them."""

    NAMES = ("first_energy", "energy", "first_entropy", "entropy", "energy_drift", "entropy_fall",
             "outside_energy", "outside_entropy", "energy_residual", "entropy_residual", "violations")
    first_energy: float
    energy: float
    first_entropy: float
    entropy: float
    energy_drift: float
    entropy_fall: float
    outside_energy: float
    outside_entropy: float
    energy_residual: float
    entropy_residual: float
    violations: float

    def __init__(self, values: Numbers) -> None:
        self._values = values

    def __getattr__(self, name: str) -> float:
        if name in Ledger.NAMES:
            return float(self._values[Ledger.NAMES.index(name)])
        raise AttributeError(name)

    def __repr__(self) -> str:
        return "Ledger(" + ", ".join(f"{n}={getattr(self, n):.10g}" for n in Ledger.NAMES) + ")"


@c.public
class Subsystem:
    """One subsystem of a scene: `state`, `energy` (J) and `entropy` (J/K) follow every step. A group
    of variables is an item: subsystem["q"]; iterating yields the names of the groups."""

    def __init__(self, scene: Scene, number: int, name: str) -> None:
        prefix = name + "."
        mine = [i for i, variable in enumerate(scene.variables) if variable.startswith(prefix)]
        self.name = name
        self.variables = [scene.variables[i] for i in mine]
        self.units = [scene.units[i] for i in mine]
        self.state = scene.state[mine[0]:mine[-1] + 1]
        self.groups = _groups(self.variables)
        self._scene, self._number = scene, number

    def __getitem__(self, group: str) -> Numbers:
        where: slice = c.look_up(self.groups, group, f"subsystem {self.name}")
        return self.state[where]

    def __iter__(self) -> typing.Iterator[str]:
        return iter(self.groups)

    def __contains__(self, group: object) -> bool:
        return group in self.groups

    def __len__(self) -> int:
        return len(self.groups)

    def __repr__(self) -> str:
        return f"<subsystem {self.name}: {', '.join(self.groups)}>"

    @property
    def energy(self) -> float:
        return float(self._scene.energy[self._number])

    @property
    def entropy(self) -> float:
        return float(self._scene.entropy[self._number])


class Port:
    """One port of a scene: `ends` are the names at its ends; `energy` (W) and `entropy` (W/K) [2] are
    the mean fluxes into them over the last step."""

    def __init__(self, name: str, ends: tuple[str, str], flux: Numbers) -> None:
        self.name, self.ends = name, ends
        self.energy, self.entropy = flux[:, 0], flux[:, 1]


@c.public
class Scene:
    """A scene file, or the `text` of one, opened at its initial state. `weights` is a folder that
    replaces those of the scene. `compiled`: its models become machine code, by the C compiler $CC or
    cc, which is kept in the user's cache; the bits are the same, and steps are faster. Subsystems are
    items: scene["upper"]; iterating yields their names. `with` closes the scene at its end."""

    name: str
    variables: list[str]
    units: list[str]
    input_names: list[str]
    input_units: list[str]
    coenergy_names: list[str]
    coenergy_units: list[str]
    reaction_names: list[str]
    reaction_units: list[str]
    state: Numbers
    energy: Numbers
    entropy: Numbers
    bulk_energy: Numbers
    bulk_entropy: Numbers
    flux: Numbers
    inputs: Numbers
    ledger: Ledger
    subsystems: dict[str, Subsystem]
    ports: dict[str, Port]

    def __init__(self, path: str | os.PathLike[str] | None = None, *, text: str | None = None,
                 weights: str | os.PathLike[str] | None = None, compiled: bool = False) -> None:
        if (path is None) == (text is None):
            raise c.UsageError("a scene needs either a path or a text")
        # copy() opens the same files, also from another working directory.
        place = os.path.abspath("text.yaml" if path is None else os.fspath(path))
        self._source = place, text, None if weights is None else os.path.abspath(os.fspath(weights)), compiled
        self._open(self._load(path if text is None else place, text, weights), compiled)

    @staticmethod
    def _load(path: typing.Any, text: str | None, weights: typing.Any) -> ctypes.c_void_p:
        pointer = ctypes.c_void_p()
        folder = c.path_bytes(weights)
        if text is None:
            c.check(c.library.portmet_scene_open(ctypes.byref(pointer), c.path_bytes(path), folder))
        else:
            c.check(c.library.portmet_scene_parse(ctypes.byref(pointer), c.text_bytes(text), c.path_bytes(path), folder))
        return pointer

    def _open(self, pointer: ctypes.c_void_p, compiled: bool = False) -> None:
        self._handle: _Handle | None = _Handle(pointer)
        if compiled:
            c.check(c.library.portmet_scene_compile(pointer))
        self._piece = 1  # steps between two looks at signals
        self._describe(self._handle)
        self._view(self._handle)

    def _describe(self, handle: _Handle) -> None:
        names = handle.names
        self.name, = names(c.SCENE)
        self.variables, self.units = names(c.VARIABLE), names(c.VARIABLE_UNIT)
        self.input_names, self.input_units = names(c.INPUT), names(c.INPUT_UNIT)
        self.coenergy_names, self.coenergy_units = names(c.COENERGY), names(c.COENERGY_UNIT)
        self.reaction_names, self.reaction_units = names(c.REACTION), names(c.REACTION_UNIT)

    def _view(self, handle: _Handle) -> None:
        size = ctypes.c_size_t()

        def array(which: int) -> Numbers:
            address = c.library.portmet_scene_array(handle.pointer, which, ctypes.byref(size))
            numbers: Numbers = handle.array(address, size.value)
            return numbers

        self.state, self.energy, self.entropy = map(array, (c.STATE, c.ENERGY, c.ENTROPY))
        self.bulk_energy, self.bulk_entropy = map(array, (c.BULK_ENERGY, c.BULK_ENTROPY))
        self.flux = array(c.FLUX).reshape(-1, 2, 4)
        self.ledger = Ledger(array(c.LEDGER))
        address = c.library.portmet_scene_inputs(handle.pointer, ctypes.byref(size))
        self.inputs = handle.array(address, size.value, writable=True)
        self.subsystems = {name: Subsystem(self, i, name) for i, name in enumerate(handle.names(c.SUBSYSTEM))}
        ends = zip(*map(handle.names, (c.PORT, c.PORT_A, c.PORT_B)))
        self.ports = {name: Port(name, (a, b), flux) for (name, a, b), flux in zip(ends, self.flux)}

    @property
    def _pointer(self) -> ctypes.c_void_p:
        if self._handle is None:
            raise c.UsageError(f"scene {self.name} is closed")
        return self._handle.pointer

    # --- as a container of subsystems ---

    def __getitem__(self, name: str) -> Subsystem:
        found: Subsystem = c.look_up(self.subsystems, name, f"scene {self.name}")
        return found

    def __iter__(self) -> typing.Iterator[str]:
        return iter(self.subsystems)

    def __contains__(self, name: object) -> bool:
        return name in self.subsystems

    def __len__(self) -> int:
        return len(self.subsystems)

    def __repr__(self) -> str:
        where = "closed" if self._handle is None else f"step {self.steps}"
        return f"<portmet scene {self.name}: {', '.join(self.subsystems)}; {where}>"

    # --- its life ---

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends a recording. Later calls raise Error; arrays stay as they are, and the memory is free
        when none of them is in use."""
        if self._handle is not None:
            handle, self._handle = self._handle, None
            c.check(c.library.portmet_scene_record(handle.pointer, None))

    def copy(self) -> Scene:
        """Returns another scene at the same state, step, ledger and inputs: both go on with the same
        bits. Nothing of the copy is recorded."""
        pointer = self._pointer
        other = Scene.__new__(Scene)
        path, text, weights, compiled = other._source = self._source
        other._open(self._load(path, text, weights), compiled)
        c.check(c.library.portmet_scene_copy(other._pointer, pointer))
        return other

    __copy__ = copy

    def __deepcopy__(self, _: object) -> Scene:
        return self.copy()

    # --- steps ---

    def step(self, count: int = 1) -> Self:
        """Takes `count` steps. Raises Error at the first failure, and does not take the failed step.
        Ctrl-C is answered between two pieces of a tenth of a second."""
        left = c.step_count(count)
        while True:
            piece, begin = min(left, self._piece), time.monotonic()
            self._check(c.library.portmet_scene_step(self._pointer, piece))
            left -= piece
            if left == 0:
                return self
            took = time.monotonic() - begin
            self._piece = max(1, self._piece // 2) if took > 0.1 else self._piece * (2 if took < 0.05 else 1)

    def _check(self, code: int) -> None:
        """Raises Error unless a call of this scene has succeeded."""
        c.check(code)

    def run(self) -> Self:
        """Steps to the end of the scene."""
        return self.step(max(0, self.planned - self.steps))

    def restart(self, state: ArrayLike | None = None) -> Self:
        """Begins again at step 0, at `state` [variables] or at the scene's initial state."""
        z = None if state is None else self._whole_state(state)
        self._check(c.library.portmet_scene_restart(self._pointer, None if z is None else z.ctypes.data))
        return self

    def _whole_state(self, state: ArrayLike) -> Numbers:
        z = numpy.ascontiguousarray(state, dtype=float)
        if z.shape != self.state.shape:
            raise c.UsageError(f"a state of {z.shape}, expected {self.state.shape}")
        return z

    def set_input(self, name: str, value: ArrayLike) -> None:
        """Prescribes the input of this name (input_names), or all components of a group ("hand.f"),
        from the next step on. NaN gives it back to the scene."""
        columns = self.input_columns(name)
        self.inputs[columns] = value

    def input_columns(self, name: str) -> list[int]:
        """Returns the positions in `inputs` of the input of this name, or of a group's components."""
        chosen = [i for i, n in enumerate(self.input_names) if name in (n, n.rpartition("[")[0])]
        if not chosen:
            raise c.UnknownName(f"scene {self.name} has no input {name}")
        return chosen

    def record(self, path: str | os.PathLike[str] | None) -> Self:
        """Records this state and every later one in an HDF5 file; None ends the recording."""
        c.check(c.library.portmet_scene_record(self._pointer, c.path_bytes(path)))
        return self

    @property
    def coenergy(self) -> Numbers:
        """The co-energies dE/dz [variables] at the present state, in `coenergy_units`: velocities,
        forces, temperatures, pressures, voltages."""
        return self._efforts()[0]

    @property
    def reaction(self) -> Numbers:
        """The rates, named by `reaction_names`, that the ports give to what boundary inputs prescribe,
        at the present state and inputs: the force of a pivot whose velocity is prescribed."""
        return self._efforts()[1]

    def _efforts(self) -> tuple[Numbers, Numbers]:
        coenergy, reaction = numpy.empty(len(self.state)), numpy.empty(len(self.reaction_names))
        c.check(c.library.portmet_scene_efforts(self._pointer, coenergy.ctypes.data, reaction.ctypes.data))
        return coenergy, reaction

    @property
    def steps(self) -> int:
        """The number of steps taken."""
        return int(c.library.portmet_scene_steps(self._pointer))

    @property
    def time(self) -> float:
        """The time in s."""
        return float(c.library.portmet_scene_time(self._pointer))

    @property
    def dt(self) -> float:
        """The length of a step in s."""
        return float(c.library.portmet_scene_dt(self._pointer))

    @property
    def planned(self) -> int:
        """The number of steps that the scene file asks for."""
        return int(c.library.portmet_scene_planned(self._pointer))

    @property
    def reference(self) -> Dataset | None:
        """The dataset of the scene's reference trajectory, or None."""
        path = [] if self._handle is None else self._handle.names(c.REFERENCE)
        return Dataset(path[0]) if path else None


@c.public
class Part(Scene):
    """A subsystem by itself, from its weights file, with no port: for looking at what was learned.
    `initial` maps each group to its values."""

    def __init__(self, weights: str | os.PathLike[str], *, dt: float,
                 initial: collections.abc.Mapping[str, ArrayLike], integrator: str = "rk4", substeps: int = 1) -> None:
        groups = Weights(weights).layout
        state = "".join(f"      {g.name}: {{unit: \"{g.unit}\", columns: [{_columns(g)}]}}\n" for g in groups)
        start = ", ".join(f"{g.name}: {_numbers(initial, g)}" for g in groups)
        super().__init__(text=(
            f"scene: part\n"
            f"time: {{dt: {float(dt)!r}, steps: 1, integrator: {integrator}, substeps: {substeps}}}\n"
            f"subsystems:\n  part:\n    weights: {os.path.abspath(os.fspath(weights))}\n"
            f"    state:\n{state}    initial: {{{start}}}\n"))


def _columns(group: Group) -> str:
    return ", ".join(f"{group.name}_{i}" for i in range(group.size))


def _numbers(initial: collections.abc.Mapping[str, ArrayLike], group: Group) -> list[float]:
    values = c.look_up(dict(initial), group.name, "the initial state")
    return [float(v) for v in numpy.broadcast_to(numpy.asarray(values, dtype=float), group.size)]
