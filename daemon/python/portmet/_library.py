"""Finds libportmet.so and declares its functions (daemon/library/portmet.h) for ctypes."""
from __future__ import annotations

import contextlib
import ctypes
import operator
import os
import typing

from . import _places

# The arrays and names of portmet.h, by their numbers there.
STATE, ENERGY, ENTROPY, BULK_ENERGY, BULK_ENTROPY, FLUX, LEDGER = range(7)
(SUBSYSTEM, VARIABLE, VARIABLE_UNIT, PORT, PORT_A, PORT_B, INPUT, INPUT_UNIT, REFERENCE,
 SCENE, COENERGY, COENERGY_UNIT, REACTION, REACTION_UNIT, WEIGHT) = range(15)


INTERRUPTED = 12  # PORTMET_EINTERRUPTED


class Error(RuntimeError):
    """What libportmet or a program of portmet refused: `code` is the exit code of its class."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text)
        self.code = code


class UsageError(Error, ValueError):
    """An argument that is not valid."""

    def __init__(self, text: str) -> None:
        super().__init__(2, text)


class UnknownName(UsageError, KeyError):
    """A name that a scene does not have."""


def place(variable: str, relative: str, name: str) -> str:
    """Returns the path in an environment variable, or the file that was built or installed with
    this package, or the bare name, which the system looks up."""
    if variable in os.environ:
        return os.environ[variable]
    path = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), relative))
    return path if os.path.exists(path) else name


def _load() -> typing.Any:
    library = ctypes.CDLL(place("PORTMET_LIBRARY", _places.LIBRARY, "libportmet.so.0"))
    text, scene, number = ctypes.c_char_p, ctypes.c_void_p, ctypes.c_double
    size = ctypes.POINTER(ctypes.c_size_t)
    signatures = {
        "portmet_version": (text, []),
        "portmet_error": (text, []),
        "portmet_scene_open": (ctypes.c_int, [ctypes.POINTER(scene), text, text]),
        "portmet_scene_parse": (ctypes.c_int, [ctypes.POINTER(scene), text, text, text]),
        "portmet_scene_connect": (ctypes.c_int, [ctypes.POINTER(scene), text, text, text, text, number]),
        "portmet_scene_close": (None, [scene]),
        "portmet_scene_compile": (ctypes.c_int, [scene]),
        "portmet_scene_copy": (ctypes.c_int, [scene, scene]),
        "portmet_scene_efforts": (ctypes.c_int, [scene, ctypes.c_void_p, ctypes.c_void_p]),
        "portmet_scene_step": (ctypes.c_int, [scene, ctypes.c_int64]),
        "portmet_scene_restart": (ctypes.c_int, [scene, ctypes.c_void_p]),
        "portmet_scene_set_state": (ctypes.c_int, [scene, ctypes.c_void_p]),
        "portmet_scene_checkpoint": (ctypes.c_int, [scene, text]),
        "portmet_scene_restore": (ctypes.c_int, [scene, text]),
        "portmet_scene_stop": (ctypes.c_int, [scene]),
        "portmet_scene_interrupt_after": (ctypes.c_int, [scene, number]),
        "portmet_scene_wait": (ctypes.c_int, [scene]),
        "portmet_scene_steps": (ctypes.c_int64, [scene]),
        "portmet_scene_time": (number, [scene]),
        "portmet_scene_dt": (number, [scene]),
        "portmet_scene_planned": (ctypes.c_int64, [scene]),
        "portmet_scene_array": (ctypes.c_void_p, [scene, ctypes.c_int, size]),
        "portmet_scene_inputs": (ctypes.c_void_p, [scene, size]),
        "portmet_scene_name": (text, [scene, ctypes.c_int, ctypes.c_size_t]),
        "portmet_scene_record": (ctypes.c_int, [scene, text]),
        "portmet_fleet_open": (ctypes.c_int, [ctypes.POINTER(scene), scene, ctypes.c_int64, ctypes.c_int]),
        "portmet_fleet_close": (None, [scene]),
        "portmet_fleet_step": (ctypes.c_int, [scene, ctypes.c_int64]),
        "portmet_fleet_array": (ctypes.c_void_p, [scene, ctypes.c_int]),
        "portmet_fleet_failure": (text, [scene]),
        "portmet_fleet_row": (ctypes.c_size_t, [scene]),
        "portmet_fleet_save": (ctypes.c_int, [scene, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p]),
        "portmet_fleet_restore": (ctypes.c_int, [scene, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p]),
        "portmet_fleet_vjp": (ctypes.c_int, [scene] + 2 * [ctypes.c_int64] + 6 * [ctypes.c_void_p]),
        "portmet_fleet_jvp": (ctypes.c_int, [scene] + 2 * [ctypes.c_int64] + 7 * [ctypes.c_void_p]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


library = _load()


def check(code: int) -> None:
    """Raises Error unless `code` is 0."""
    if code != 0:
        raise Error(code, library.portmet_error().decode())


def step_count(count: typing.Any, what: str = "steps") -> int:
    """Returns a number of steps, or of something else, as libportmet takes it."""
    try:
        number = operator.index(count)
    except TypeError:
        raise UsageError(f"{count!r} {what}: expected a whole number") from None
    if not 0 <= number < 1 << 63:
        raise UsageError(f"{number} {what}: expected 0 to 2^63 - 1")
    return number


@contextlib.contextmanager
def argument(what: str) -> typing.Iterator[None]:
    """Makes an Error of numpy's refusal of an argument."""
    try:
        yield
    except Error:
        raise
    except (TypeError, ValueError, IndexError) as error:
        raise UsageError(f"{what}: {error}") from None


def look_up(table: dict[str, typing.Any], name: str, what: str) -> typing.Any:
    """Returns the item of a table that has this name."""
    if name not in table:
        raise UnknownName(f"{what} has no {name!r}; there are: {', '.join(table)}")
    return table[name]


def path_bytes(path: str | os.PathLike[str] | None) -> bytes | None:
    return None if path is None else os.fsencode(path)


def version() -> str:
    """Returns the version of libportmet."""
    return str(library.portmet_version().decode())
