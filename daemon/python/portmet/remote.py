"""A scene that `portmetd serve` steps elsewhere, with the methods and arrays of Scene."""
import ctypes

from . import _library as c
from .scene import Scene


class Remote(Scene):
    """The scene `name` (or "name:session") that `portmetd serve` offers at the LCM `url`. Opening it begins a run
    without a last step, held at the scene's initial state; `record` names its recording in the folder of the
    service, and `key_file` holds the key of the scene. `inputs` are its live inputs. A call fails after `timeout`
    seconds without an answer."""

    def __init__(self, name, *, url=None, key_file=None, record=None, timeout=10.0):
        pointer = ctypes.c_void_p()
        c.check(c.library.portmet_scene_connect(
            ctypes.byref(pointer), name.encode(), None if url is None else url.encode(), c.path_bytes(key_file),
            None if record is None else record.encode(), timeout))
        self._open(pointer)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def set_state(self, state):
        """Goes on at `state` [variables] with the next step. The energy and the entropy by which it differs
        come from the outside: the totals of the ledger stay."""
        state = self._whole_state(state)
        c.check(c.library.portmet_scene_set_state(self._pointer, state.ctypes.data))
        return self

    def checkpoint(self, name):
        """Keeps state and ledger under `name` in the folder of the service."""
        c.check(c.library.portmet_scene_checkpoint(self._pointer, name.encode()))
        return self

    def restore(self, name):
        """Takes the run to what is kept under `name`, by this run or an earlier one."""
        c.check(c.library.portmet_scene_restore(self._pointer, name.encode()))
        return self

    def close(self):
        """Ends the run; the service stays, and so do the arrays."""
        c.check(c.library.portmet_scene_stop(self._pointer))
