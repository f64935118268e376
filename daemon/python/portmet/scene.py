"""Scenes and parts to step in this process."""
import ctypes
import os
import re
import time

import numpy

from . import _library as c
from .files import Dataset, Weights


class _Handle:
    """The scene in libportmet. It is closed when neither the Scene nor any of its arrays is in use."""

    def __init__(self, pointer):
        self.pointer = pointer

    def __del__(self):
        c.library.portmet_scene_close(self.pointer)

    def array(self, address, size, writable=False, kind=float):
        """Returns the `size` numbers at `address` as a numpy array that keeps the scene open."""
        if not address:
            return numpy.empty(0)
        memory = (numpy.ctypeslib.as_ctypes_type(kind) * size).from_address(address)
        memory.handle = self
        array = numpy.frombuffer(memory, kind)
        array.flags.writeable = writable
        return array

    def names(self, kind):
        result = []
        while (name := c.library.portmet_scene_name(self.pointer, kind, len(result))) is not None:
            result.append(name.decode())
        return result


def _groups(names):
    """Returns {group: slice} for the names "owner.group[i]" of one owner, which begin at 0."""
    result = {}
    for i, name in enumerate(names):
        group = re.fullmatch(r"[^.]*\.(.*)\[\d+\]", name)[1]
        first = result[group].start if group in result else i
        result[group] = slice(first, i + 1)
    return result


class Ledger:
    """Both laws over the steps so far. Its members follow every step; repr() lists them."""

    NAMES = ("first_energy", "energy", "first_entropy", "entropy", "energy_drift", "entropy_fall",
             "outside_energy", "outside_entropy", "energy_residual", "entropy_residual", "violations")

    def __init__(self, values):
        self._values = values

    def __getattr__(self, name):
        if name in Ledger.NAMES:
            return float(self._values[Ledger.NAMES.index(name)])
        raise AttributeError(name)

    def __repr__(self):
        return "Ledger(" + ", ".join(f"{n}={getattr(self, n):.10g}" for n in Ledger.NAMES) + ")"


class Subsystem:
    """One subsystem of a scene: `state`, `energy` (J) and `entropy` (J/K) follow every step. A group
    of variables is an item: subsystem["q"]."""

    def __init__(self, scene, number, name):
        prefix = name + "."
        mine = [i for i, variable in enumerate(scene.variables) if variable.startswith(prefix)]
        self.name = name
        self.variables = [scene.variables[i] for i in mine]
        self.units = [scene.units[i] for i in mine]
        self.state = scene.state[mine[0]:mine[-1] + 1]
        self.groups = _groups(self.variables)
        self._scene, self._number = scene, number

    def __getitem__(self, group):
        return self.state[c.look_up(self.groups, group, f"subsystem {self.name}")]

    @property
    def energy(self):
        return float(self._scene.energy[self._number])

    @property
    def entropy(self):
        return float(self._scene.entropy[self._number])


class Port:
    """One port of a scene: `ends` are the names at its ends; `energy` (W) and `entropy` (W/K) [2] are
    the mean fluxes into them over the last step."""

    def __init__(self, name, ends, flux):
        self.name, self.ends = name, ends
        self.energy, self.entropy = flux[:, 0], flux[:, 1]


class Scene:
    """A scene file, or the `text` of one, opened at its initial state. `weights` is a folder that
    replaces those of the scene. `compiled`: its models become machine code, by the C compiler $CC or
    cc, which is kept in the user's cache; the bits are the same, and steps are faster."""

    def __init__(self, path=None, *, text=None, weights=None, compiled=False):
        if (path is None) == (text is None):
            raise TypeError("a scene needs either a path or a text")
        pointer = ctypes.c_void_p()
        folder = c.path_bytes(weights)
        if text is None:
            c.check(c.library.portmet_scene_open(ctypes.byref(pointer), c.path_bytes(path), folder))
        else:
            here = os.fsencode(os.path.join(os.getcwd(), "text.yaml"))
            c.check(c.library.portmet_scene_parse(ctypes.byref(pointer), text.encode(), here, folder))
        self._open(pointer, compiled)

    def _open(self, pointer, compiled=False):
        self._handle = _Handle(pointer)
        if compiled:
            c.check(c.library.portmet_scene_compile(pointer))
        self._piece = 1  # steps between two looks at signals
        self._describe()
        self._view()

    def _describe(self):
        names = self._handle.names
        self.name, = names(c.SCENE)
        self.variables, self.units = names(c.VARIABLE), names(c.VARIABLE_UNIT)
        self.input_names, self.input_units = names(c.INPUT), names(c.INPUT_UNIT)

    def _array(self, which):
        size = ctypes.c_size_t()
        address = c.library.portmet_scene_array(self._pointer, which, ctypes.byref(size))
        return self._handle.array(address, size.value)

    def _view(self):
        self.state, self.energy, self.entropy = map(self._array, (c.STATE, c.ENERGY, c.ENTROPY))
        self.bulk_energy, self.bulk_entropy = map(self._array, (c.BULK_ENERGY, c.BULK_ENTROPY))
        self.flux = self._array(c.FLUX).reshape(-1, 2, 4)
        self.ledger = Ledger(self._array(c.LEDGER))
        size = ctypes.c_size_t()
        address = c.library.portmet_scene_inputs(self._pointer, ctypes.byref(size))
        self.inputs = self._handle.array(address, size.value, writable=True)
        self.subsystems = {name: Subsystem(self, i, name)
                           for i, name in enumerate(self._handle.names(c.SUBSYSTEM))}
        ends = zip(*map(self._handle.names, (c.PORT, c.PORT_A, c.PORT_B)))
        self.ports = {name: Port(name, (a, b), flux) for (name, a, b), flux in zip(ends, self.flux)}

    @property
    def _pointer(self):
        return self._handle.pointer

    def __getitem__(self, name):
        return c.look_up(self.subsystems, name, f"scene {self.name}")

    def __repr__(self):
        return f"<portmet scene {self.name}: {', '.join(self.subsystems)}; step {self.steps}>"

    def step(self, count=1):
        """Takes `count` steps. Raises Error at the first failure, and does not take the failed step.
        Ctrl-C is answered between two pieces of a tenth of a second."""
        left = c.step_count(count)
        while True:
            piece, begin = min(left, self._piece), time.monotonic()
            c.check(c.library.portmet_scene_step(self._pointer, piece))
            left -= piece
            if left == 0:
                return self
            took = time.monotonic() - begin
            self._piece = max(1, self._piece // 2) if took > 0.1 else self._piece * (2 if took < 0.05 else 1)

    def run(self):
        """Steps to the end of the scene."""
        return self.step(max(0, self.planned - self.steps))

    def restart(self, state=None):
        """Begins again at step 0, at `state` [variables] or at the scene's initial state."""
        state = None if state is None else self._whole_state(state)
        c.check(c.library.portmet_scene_restart(self._pointer, None if state is None else state.ctypes.data))
        return self

    def _whole_state(self, state):
        state = numpy.ascontiguousarray(state, dtype=float)
        if state.shape != self.state.shape:
            raise c.UsageError(f"a state of {state.shape}, expected {self.state.shape}")
        return state

    def set_input(self, name, value):
        """Prescribes the input of this name (input_names), or all components of a group ("hand.f"),
        from the next step on. NaN gives it back to the scene."""
        self.inputs[self.input_columns(name)] = value

    def input_columns(self, name):
        """Returns the positions in `inputs` of the input of this name, or of a group's components."""
        chosen = [i for i, n in enumerate(self.input_names) if name in (n, n.rpartition("[")[0])]
        if not chosen:
            raise c.UnknownName(f"scene {self.name} has no input {name}")
        return chosen

    def record(self, path):
        """Records this state and every later one in an HDF5 file; None ends the recording."""
        c.check(c.library.portmet_scene_record(self._pointer, c.path_bytes(path)))
        return self

    @property
    def steps(self):
        """The number of steps taken."""
        return c.library.portmet_scene_steps(self._pointer)

    @property
    def time(self):
        """The time in s."""
        return c.library.portmet_scene_time(self._pointer)

    @property
    def dt(self):
        """The length of a step in s."""
        return c.library.portmet_scene_dt(self._pointer)

    @property
    def planned(self):
        """The number of steps that the scene file asks for."""
        return c.library.portmet_scene_planned(self._pointer)

    @property
    def reference(self):
        """The dataset of the scene's reference trajectory, or None."""
        path = self._handle.names(c.REFERENCE)
        return Dataset(path[0]) if path else None


class Part(Scene):
    """A subsystem by itself, from its weights file, with no port: for looking at what was learned.
    `initial` maps each group to its values."""

    def __init__(self, weights, *, dt, initial, integrator="rk4", substeps=1):
        groups = Weights(weights).layout
        state = "".join(f"      {g.name}: {{unit: \"{g.unit}\", columns: [{_columns(g)}]}}\n" for g in groups)
        start = ", ".join(f"{g.name}: {_numbers(initial[g.name], g.size)}" for g in groups)
        super().__init__(text=(
            f"scene: part\n"
            f"time: {{dt: {dt!r}, steps: 1, integrator: {integrator}, substeps: {substeps}}}\n"
            f"subsystems:\n  part:\n    weights: {os.path.abspath(os.fspath(weights))}\n"
            f"    state:\n{state}    initial: {{{start}}}\n"))


def _columns(group):
    return ", ".join(f"{group.name}_{i}" for i in range(group.size))


def _numbers(values, size):
    return [float(v) for v in numpy.broadcast_to(numpy.asarray(values, dtype=float), size)]
