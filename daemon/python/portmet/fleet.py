"""Many copies of one scene, stepped together."""
import ctypes
import re
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


def _address(array):
    return None if array is None else array.ctypes.data


@c.public
class Fleet:
    """`n` copies of a scene, at its initial state. `threads` share them; 0: as many as there are
    processors. Each copy has the bits of a Scene alone. The arrays `state` [n, variables], `inputs`
    [n, inputs], `steps` [n] and `ended` [n] may be written between two calls; `energy` (J) and
    `entropy` (J/K) are [n, subsystems]. A copy whose step fails has its error code in `ended` and
    stays in the state before; a copy where you write any number rests until you write 0."""

    def __init__(self, scene, n, threads=0):
        self.scene = scene if isinstance(scene, Scene) else Scene(scene)
        self.n, self._piece = c.step_count(n, "copies"), 1
        threads = min(c.step_count(threads, "threads"), 2**31 - 1)  # the library says how many there may be
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

    def rollout(self, inputs=None, steps=1, start=None, pieces=1):
        """Returns the states [pieces, n, variables] at the ends of `pieces` times `steps` steps from
        `start`, or from the present states, and leaves the copies as they are. `inputs` [pieces, n,
        inputs] hold during a piece; they say how many there are. States of a copy that fails are NaN."""
        pieces, inputs = self._pieces(inputs, pieces)
        kept, held = self.save(), self.inputs.copy()
        states = numpy.empty((pieces, *self.state.shape))
        try:
            if start is not None:
                self.state[:] = start
            for piece in range(pieces):
                self.step(steps, None if inputs is None else inputs[piece])
                states[piece] = numpy.where(self.ended[:, None] == 0, self.state, numpy.nan)
        finally:
            self.restore(kept)
            self.inputs[:] = held
        return states

    def vjp(self, seed, inputs=None, steps=1, start=None, weights=False):
        """Returns the gradient of the sum of `seed` [pieces, n, variables] times rollout(inputs,
        steps, start), for each copy: by the start [n, variables], and by the inputs [pieces, n,
        inputs]; with `weights` also by the scene's weights [n, weights], in the order of
        weight_names. An input that is NaN counts as a shift of the scene's own value."""
        seed = numpy.ascontiguousarray(seed, dtype=float)
        steps = c.step_count(steps)
        pieces, inputs = self._pieces(inputs, len(seed) if seed.ndim == 3 else 1)
        seed = self._row(seed, pieces, len(self.scene.variables))
        start = self._row(start, None, len(self.scene.variables))
        by = [numpy.empty(self.state.shape), numpy.empty((pieces, *self.inputs.shape))]
        if weights:
            by.append(numpy.empty((self.n, sum(map(len, self.weight_names.values())))))
        c.check(c.library.portmet_fleet_vjp(self._handle.pointer, pieces, steps, _address(start), _address(inputs),
                                            _address(seed), *map(_address, by), *([] if weights else [None])))
        return tuple(by)

    def jvp(self, d_start=None, d_inputs=None, d_weights=None, *, inputs=None, steps=1, start=None, pieces=1):
        """Returns the states of rollout(inputs, steps, start, pieces), and their derivatives, of the
        same shape, along directions of start, inputs and weights, in the shapes of vjp."""
        steps = c.step_count(steps)
        pieces, inputs = self._pieces(inputs, pieces)
        size, names = len(self.scene.variables), self.weight_names if d_weights is not None else {}
        given = (self._row(start, None, size), inputs, self._row(d_start, None, size),
                 self._row(d_inputs, pieces, self.inputs.shape[1]),
                 self._row(d_weights, None, sum(map(len, names.values()))))
        states, tangents = numpy.empty((2, pieces, *self.state.shape))
        c.check(c.library.portmet_fleet_jvp(self._handle.pointer, pieces, steps, *map(_address, given),
                                            _address(states), _address(tangents)))
        return states, tangents

    @property
    def weight_names(self):
        """Where each matrix of weights, such as "joint.constant.K", is among all weights: a range."""
        result, first = {}, 0
        for text in self._handle.scene.names(c.WEIGHT):
            name, rows, columns = re.fullmatch(r"(.*)\[(\d+)\]\[(\d+)\]", text).groups()
            result[name] = range(first, first + int(rows) * int(columns))
            first = result[name].stop
        return result

    def _pieces(self, inputs, pieces):
        """Returns the number of pieces, and the inputs [pieces, n, inputs], or None."""
        pieces = c.step_count(pieces, "pieces")
        if inputs is None:
            return pieces, None
        inputs = numpy.asarray(inputs, dtype=float)
        pieces = len(inputs) if inputs.ndim == 3 else pieces
        return pieces, self._row(inputs, pieces, self.inputs.shape[1])

    def _row(self, values, pieces, columns):
        """Returns numbers as an array [n, columns], or [pieces, n, columns]; None stays None."""
        shape = (self.n, columns) if pieces is None else (pieces, self.n, columns)
        return None if values is None else numpy.ascontiguousarray(numpy.broadcast_to(values, shape), dtype=float)

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
