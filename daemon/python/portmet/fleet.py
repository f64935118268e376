# SPDX-License-Identifier: MIT
"""Many copies of one scene, stepped together."""
from __future__ import annotations

import ctypes
import re
import time
import typing

import numpy

from . import _library as c
from .scene import Scene, _Handle

if typing.TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from typing_extensions import Self

    from .files import Numbers, Path
    Copies = typing.Union[int, slice, list[int], NDArray[typing.Any], None]  # numbers of copies; None: all

STATE, INPUTS, ENERGY, ENTROPY, STEPS, ENDED = range(6)  # of portmet.h


class _FleetHandle(_Handle):
    """The copies in libportmet, and the scene of which they are."""

    def __init__(self, pointer: ctypes.c_void_p, scene: _Handle) -> None:
        super().__init__(pointer)
        self.scene = scene

    def __del__(self) -> None:
        c.library.portmet_fleet_close(self.pointer)


def _address(array: NDArray[typing.Any] | None) -> int | None:
    return None if array is None else int(array.ctypes.data)


@c.public
class Fleet:
    """`n` copies of a scene, at its initial state. `threads` share them; 0: as many as there are
    processors. Each copy has the bits of a Scene alone. The arrays `state` [n, variables], `inputs`
    [n, inputs], `steps` [n] and `ended` [n] may be written between two calls; `energy` (J) and
    `entropy` (J/K) are [n, subsystems]. A copy whose step fails has its error code in `ended` and
    stays in the state before; a copy where you write any number rests until you write 0."""

    def __init__(self, scene: Scene | Path, n: int, threads: int = 0) -> None:
        self.scene = scene if isinstance(scene, Scene) else Scene(scene)
        self.n, self._piece = c.step_count(n, "copies"), 1
        threads = min(c.step_count(threads, "threads"), 2**31 - 1)  # the library says how many there may be
        pointer = ctypes.c_void_p()
        c.check(c.library.portmet_fleet_open(ctypes.byref(pointer), self.scene._pointer, self.n, threads))
        assert self.scene._handle is not None  # the scene is open
        self._handle = _FleetHandle(pointer, self.scene._handle)
        self.state: Numbers = self._array(STATE)
        self.energy: Numbers = self._array(ENERGY)
        self.entropy: Numbers = self._array(ENTROPY)
        self.inputs: Numbers = self._array(INPUTS)
        self.steps: NDArray[numpy.int64] = self._array(STEPS, numpy.int64)[:, 0]
        self.ended: NDArray[numpy.intc] = self._array(ENDED, numpy.intc)[:, 0]
        self.failure = ""

    def _array(self, which: int, kind: typing.Any = float) -> typing.Any:
        columns = {STATE: len(self.scene.variables), INPUTS: len(self.scene.input_names), STEPS: 1,
                   ENDED: 1}.get(which, len(self.scene.subsystems))
        address = c.library.portmet_fleet_array(self._handle.pointer, which)
        return self._handle.array(address, self.n * columns, True, kind).reshape(self.n, columns)

    def step(self, count: int = 1, inputs: ArrayLike | None = None) -> Self:
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

    def rollout(self, inputs: ArrayLike | None = None, steps: int = 1, start: ArrayLike | None = None,
                pieces: int = 1) -> Numbers:
        """Returns the states [pieces, n, variables] at the ends of `pieces` times `steps` steps from
        `start`, or from the present states, and leaves the copies as they are. `inputs` [pieces, n,
        inputs] hold during a piece; they say how many there are. States of a copy that fails are NaN."""
        pieces, held_inputs = self._pieces(inputs, pieces)
        kept, held = self.save(), self.inputs.copy()
        states = numpy.empty((pieces, *self.state.shape))
        try:
            if start is not None:
                self.state[:] = start
            for piece in range(pieces):
                self.step(steps, None if held_inputs is None else held_inputs[piece])
                states[piece] = numpy.where(self.ended[:, None] == 0, self.state, numpy.nan)
        finally:
            self.restore(kept)
            self.inputs[:] = held
        return states

    def vjp(self, seed: ArrayLike, inputs: ArrayLike | None = None, steps: int = 1, start: ArrayLike | None = None,
            weights: bool = False) -> tuple[Numbers, ...]:
        """Returns the gradient of the sum of `seed` [pieces, n, variables] times rollout(inputs,
        steps, start), for each copy: by the start [n, variables], and by the inputs [pieces, n,
        inputs]; with `weights` also by the scene's weights [n, weights], in the order of
        weight_names. An input that is NaN counts as a shift of the scene's own value."""
        seeds = numpy.ascontiguousarray(seed, dtype=float)
        steps = c.step_count(steps)
        pieces, held = self._pieces(inputs, len(seeds) if seeds.ndim == 3 else 1)
        given = (self._row(start, None, len(self.scene.variables)), held,
                 self._row(seeds, pieces, len(self.scene.variables)))
        by = [numpy.empty(self.state.shape), numpy.empty((pieces, *self.inputs.shape))]
        if weights:
            by.append(numpy.empty((self.n, sum(map(len, self.weight_names.values())))))
        c.check(c.library.portmet_fleet_vjp(self._handle.pointer, pieces, steps, *map(_address, given),
                                            *map(_address, by), *([] if weights else [None])))
        return tuple(by)

    def jvp(self, d_start: ArrayLike | None = None, d_inputs: ArrayLike | None = None,
            d_weights: ArrayLike | None = None, *, inputs: ArrayLike | None = None, steps: int = 1,
            start: ArrayLike | None = None, pieces: int = 1) -> tuple[Numbers, Numbers]:
        """Returns the states of rollout(inputs, steps, start, pieces), and their derivatives, of the
        same shape, along directions of start, inputs and weights, in the shapes of vjp."""
        steps = c.step_count(steps)
        pieces, held = self._pieces(inputs, pieces)
        size, names = len(self.scene.variables), self.weight_names if d_weights is not None else {}
        given = (self._row(start, None, size), held, self._row(d_start, None, size),
                 self._row(d_inputs, pieces, self.inputs.shape[1]),
                 self._row(d_weights, None, sum(map(len, names.values()))))
        states, tangents = numpy.empty((2, pieces, *self.state.shape))
        c.check(c.library.portmet_fleet_jvp(self._handle.pointer, pieces, steps, *map(_address, given),
                                            _address(states), _address(tangents)))
        return states, tangents

    @property
    def weight_names(self) -> dict[str, range]:
        """Where each matrix of weights, such as "joint.constant.K", is among all weights: a range."""
        result, first = {}, 0
        for text in self._handle.scene.names(c.WEIGHT):
            name, rows, columns = re.findall(r"(.*)\[(\d+)\]\[(\d+)\]", text)[0]
            result[name] = range(first, first + int(rows) * int(columns))
            first = result[name].stop
        return result

    def _pieces(self, inputs: ArrayLike | None, pieces: int) -> tuple[int, Numbers | None]:
        """Returns the number of pieces, and the inputs [pieces, n, inputs], or None."""
        pieces = c.step_count(pieces, "pieces")
        if inputs is None:
            return pieces, None
        held = numpy.asarray(inputs, dtype=float)
        pieces = len(held) if held.ndim == 3 else pieces
        return pieces, self._row(held, pieces, self.inputs.shape[1])

    def _row(self, values: ArrayLike | None, pieces: int | None, columns: int) -> Numbers | None:
        """Returns numbers as an array [n, columns], or [pieces, n, columns]; None stays None."""
        shape = (self.n, columns) if pieces is None else (pieces, self.n, columns)
        return None if values is None else numpy.ascontiguousarray(numpy.broadcast_to(values, shape), dtype=float)

    def set_input(self, name: str, values: ArrayLike) -> None:
        """Prescribes an input as Scene.set_input does; `values` are one number, or one for each copy."""
        columns = self.scene.input_columns(name)
        self.inputs[:, columns] = numpy.reshape(values, (-1, 1)) if numpy.ndim(values) == 1 else values

    def save(self, copies: Copies = None) -> Numbers:
        """Returns the copies of these numbers, or all, as rows that restore() takes. A row has all but
        the inputs."""
        which = self._numbers(copies)
        rows = numpy.empty((len(which), c.library.portmet_fleet_row(self._handle.pointer)))
        c.check(c.library.portmet_fleet_save(self._handle.pointer, len(which), which.ctypes.data, rows.ctypes.data))
        return rows

    def restore(self, rows: ArrayLike, copies: Copies = None) -> Self:
        """Puts saved rows back into the copies of these numbers, or all. One row serves many copies."""
        which = self._numbers(copies)
        shape = len(which), c.library.portmet_fleet_row(self._handle.pointer)
        rows = numpy.ascontiguousarray(numpy.broadcast_to(rows, shape), dtype=float)
        c.check(c.library.portmet_fleet_restore(self._handle.pointer, len(which), which.ctypes.data, rows.ctypes.data))
        return self

    def _numbers(self, copies: Copies) -> NDArray[numpy.int64]:
        every = numpy.arange(self.n, dtype=numpy.int64)
        return every if copies is None else numpy.ascontiguousarray(every[copies]).reshape(-1)

    @property
    def time(self) -> Numbers:
        """The times [n] in s."""
        return self.steps * self.scene.dt

    def __len__(self) -> int:
        return self.n

    def __repr__(self) -> str:
        return f"<{self.n} copies of the portmet scene {self.scene.name}; {numpy.count_nonzero(self.ended)} ended>"
