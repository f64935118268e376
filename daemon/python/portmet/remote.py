# SPDX-License-Identifier: MIT
"""A scene that `portmetd serve` steps elsewhere, with the methods and arrays of Scene."""
from __future__ import annotations

import ctypes
import os
import typing

from . import _library as c
from .scene import Scene

if typing.TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Self


_LOOK = 0.1  # s of waiting between two looks at signals


@c.public
class Remote(Scene):
    """The scene `name` (or "name:session") that `portmetd serve` offers at the LCM `url`. Opening it begins a run
    without a last step, held at the scene's initial state; `record` names its recording in the folder of the
    service, and `key_file` holds the key of the scene. `inputs` are its live inputs. A call fails after `timeout`
    seconds without an answer, or of waiting for an input that nobody gives; such a step is not taken."""

    def __init__(self, name: str, *, url: str | None = None, key_file: str | os.PathLike[str] | None = None,
                 record: str | None = None, timeout: float = 10.0) -> None:
        if not timeout > 0:
            raise ValueError("expected a timeout of more than 0 s")
        pointer = ctypes.c_void_p()
        c.check(c.library.portmet_scene_connect(
            ctypes.byref(pointer), c.text_bytes(name), c.text_bytes(url), c.path_bytes(key_file), c.text_bytes(record),
            timeout))
        self._open(pointer)
        c.check(c.library.portmet_scene_interrupt_after(self._pointer, _LOOK))

    def _check(self, code: int) -> None:
        while code == c.INTERRUPTED:  # signals, such as Ctrl-C, are answered between two waits
            code = c.library.portmet_scene_wait(self._pointer)
        c.check(code)

    def set_state(self, state: ArrayLike) -> Self:
        """Goes on at `state` [variables] with the next step. The energy and the entropy by which it differs
        come from the outside: the totals of the ledger stay."""
        z = self._whole_state(state)  # stays until there is an answer
        self._check(c.library.portmet_scene_set_state(self._pointer, z.ctypes.data))
        return self

    def checkpoint(self, name: str) -> Self:
        """Keeps state and ledger under `name` in the folder of the service."""
        self._check(c.library.portmet_scene_checkpoint(self._pointer, c.text_bytes(name)))
        return self

    def restore(self, name: str) -> Self:
        """Takes the run to what is kept under `name`, by this run or an earlier one."""
        self._check(c.library.portmet_scene_restore(self._pointer, c.text_bytes(name)))
        return self

    def close(self) -> None:
        """Ends the run; the service stays, and so do the arrays."""
        self._check(c.library.portmet_scene_stop(self._pointer))

    def copy(self) -> Scene:
        """Is refused: checkpoint() keeps the state of a run."""
        raise c.UsageError(f"scene {self.name} is stepped elsewhere; checkpoint() keeps its state")

    __copy__ = copy
