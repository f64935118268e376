"""Many copies of one scene, stepped together."""
import ctypes
import time

import numpy

from . import _library as c
from .scene import Scene, _Handle

STATE, INPUTS, ENERGY, ENTROPY, STEPS, ENDED = range(6)  # of portmet.h


class _FleetHandle(_Handle):
    """The copies in libportmet, and the scene of which they are."""

    def __init__(self, pointer, scene):
        super().__init__(pointer)
        self.scene = scene

    def __del__(self):
        c.library.portmet_fleet_close(self.pointer)


class Fleet:
    """`n` copies of a scene, at its initial state. `threads` share them; 0: as many as there are
    processors. Each copy has the bits of a Scene alone. The arrays `state` [n, variables], `inputs`
    [n, inputs], `steps` [n] and `ended` [n] may be written between two calls; `energy` (J) and
    `entropy` (J/K) are [n, subsystems]. A copy whose step fails has its error code in `ended` and
    stays in the state before; a copy where you write any number rests until you write 0."""

    def __init__(self, scene, n, threads=0):
        self.scene = scene if isinstance(scene, Scene) else Scene(scene)
        self.n, self._piece = c.step_count(n), 1
        pointer = ctypes.c_void_p()
        c.check(c.library.portmet_fleet_open(ctypes.byref(pointer), self.scene._pointer, self.n, threads))
        self._handle = _FleetHandle(pointer, self.scene._handle)
        self.state, self.energy, self.entropy = map(self._array, (STATE, ENERGY, ENTROPY))
        self.inputs = self._array(INPUTS)
        self.steps, self.ended = self._array(STEPS, numpy.int64)[:, 0], self._array(ENDED, numpy.intc)[:, 0]

    def _array(self, which, kind=float):
        columns = {STATE: len(self.scene.variables), INPUTS: len(self.scene.input_names), STEPS: 1,
                   ENDED: 1}.get(which, len(self.scene.subsystems))
        address = c.library.portmet_fleet_array(self._handle.pointer, which)
        return self._handle.array(address, self.n * columns, True, kind).reshape(self.n, columns)

    def step(self, count=1, inputs=None):
        """Takes `count` steps of every copy that has not ended, with `inputs` if they are given: an
        array that numpy can broadcast to [n, inputs]. Copies that fail raise nothing: see `ended`
        and `failure`. Ctrl-C is answered between two pieces of a tenth of a second."""
        if inputs is not None:
            self.inputs[:] = inputs
        left, self.failure = c.step_count(count), ""
        while True:
            piece, begin = min(left, self._piece), time.monotonic()
            c.check(c.library.portmet_fleet_step(self._handle.pointer, piece))
            self.failure = self.failure or c.library.portmet_fleet_failure(self._handle.pointer).decode()
            left -= piece
            if left == 0:
                return self
            took = time.monotonic() - begin
            self._piece = max(1, self._piece // 2) if took > 0.1 else self._piece * (2 if took < 0.05 else 1)

    def set_input(self, name, values):
        """Prescribes an input as Scene.set_input does; `values` are one number, or one for each copy."""
        columns = self.scene.input_columns(name)
        self.inputs[:, columns] = numpy.reshape(values, (-1, 1)) if numpy.ndim(values) == 1 else values

    def save(self, copies=None):
        """Returns the copies of these numbers, or all, as rows that restore() takes. A row has all but
        the inputs."""
        which = self._numbers(copies)
        rows = numpy.empty((len(which), c.library.portmet_fleet_row(self._handle.pointer)))
        c.check(c.library.portmet_fleet_save(self._handle.pointer, len(which), which.ctypes.data, rows.ctypes.data))
        return rows

    def restore(self, rows, copies=None):
        """Puts saved rows back into the copies of these numbers, or all. One row serves many copies."""
        which = self._numbers(copies)
        shape = len(which), c.library.portmet_fleet_row(self._handle.pointer)
        rows = numpy.ascontiguousarray(numpy.broadcast_to(rows, shape), dtype=float)
        c.check(c.library.portmet_fleet_restore(self._handle.pointer, len(which), which.ctypes.data, rows.ctypes.data))
        return self

    def _numbers(self, copies):
        every = numpy.arange(self.n, dtype=numpy.int64)
        return every if copies is None else numpy.ascontiguousarray(every[copies]).reshape(-1)

    @property
    def time(self):
        """The times [n] in s."""
        return self.steps * self.scene.dt

    def __len__(self):
        return self.n

    def __repr__(self):
        return f"<{self.n} copies of the portmet scene {self.scene.name}; {numpy.count_nonzero(self.ended)} ended>"
