"""A scene that `portmetd serve` steps elsewhere, with the methods and arrays of Scene."""
import ctypes

from . import _library as c
from .scene import Scene


class Remote(Scene):
    """The scene `name` that `portmetd serve` offers at the LCM `url`. Opening it begins a run without a last
    step, held at the scene's initial state; `record` names its recording in the folder of the service, and
    `key_file` holds the key of the scene. `inputs` are its live inputs. A call fails after `timeout` seconds
    without an answer."""

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

    def close(self):
        """Ends the run; the service stays, and so do the arrays."""
        c.check(c.library.portmet_scene_stop(self._pointer))
