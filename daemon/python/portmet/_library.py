# SPDX-License-Identifier: MIT
"""Finds libportmet.so and declares its functions (daemon/library/portmet.h) for ctypes."""
from __future__ import annotations

import ctypes
import functools
import inspect
import operator
import os
import reprlib
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
    try:
        library = ctypes.CDLL(place("PORTMET_LIBRARY", _places.LIBRARY, "libportmet.so.0"))
    except OSError as error:
        raise OSError(f"{error} (PORTMET_LIBRARY may name the file)") from None
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
    number = operator.index(count)
    if not 0 <= number < 1 << 63:
        raise UsageError(f"{number} {what}: expected 0 to 2^63 - 1")
    return number


Public = typing.TypeVar("Public", bound=typing.Callable[..., typing.Any])


def public(what: Public) -> Public:
    """Decorates a function, or all public methods of a class: where Python, numpy or the system refuses
    what it was given, it raises an Error, which names the arguments with their values."""
    if isinstance(what, type):
        for name, method in list(vars(what).items()):
            if inspect.isfunction(method) and (name in ("__init__", "__getitem__") or not name.startswith("_")):
                setattr(what, name, public(method))
        return what  # type: ignore[return-value]

    @functools.wraps(what)
    def call(*given: typing.Any, **named: typing.Any) -> typing.Any:
        try:
            return what(*given, **named)
        except Error:
            raise
        except OSError as error:
            raise Error(4, str(error)) from error
        except (TypeError, ValueError, AttributeError, IndexError, ctypes.ArgumentError) as error:
            raise UsageError(f"{_call_text(what, given, named)}: {error}") from error

    return typing.cast(Public, call)


def _call_text(function: typing.Callable[..., typing.Any], given: tuple[typing.Any, ...], named: dict[str, typing.Any]) -> str:
    """Returns a call as text, "Dataset(z='abc', dt=0.1)", or the function alone if it has no such arguments."""
    name = function.__qualname__.replace(".__init__", "")
    try:
        arguments = inspect.signature(function).bind(*given, **named).arguments
    except TypeError:
        return name
    return f"{name}({', '.join(f'{key}={reprlib.repr(value)}' for key, value in arguments.items() if key != 'self')})"


def look_up(table: dict[str, typing.Any], name: str, what: str) -> typing.Any:
    """Returns the item of a table that has this name."""
    if name not in table:
        raise UnknownName(f"{what} has no {name!r}; there are: {', '.join(table)}")
    return table[name]


def path_bytes(path: str | os.PathLike[str] | None) -> bytes | None:
    """Returns a path as libportmet takes it."""
    return None if path is None else _without_zero(os.fsencode(path), path)


def text_bytes(text: str | None) -> bytes | None:
    """Returns a text as libportmet takes it."""
    if text is not None and not isinstance(text, str):
        raise TypeError(f"expected a text, found {text!r}")
    return None if text is None else _without_zero(text.encode(), text)


def _without_zero(data: bytes, value: typing.Any) -> bytes:
    if b"\0" in data:  # libportmet would read the part before it
        raise ValueError(f"a zero byte in {value!r}")
    return data


def version() -> str:
    """Returns the version of libportmet."""
    return str(library.portmet_version().decode())
