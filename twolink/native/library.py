"""The C library, found and loaded: one that was built from other sources than these is refused."""

import ctypes
import functools
import hashlib
import logging
import os
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from twolink.errors import TwolinkError

FOLDER = Path(__file__).parent
NAMES = ("libtwolink.so", "libtwolink.dylib", "twolink.dll")
OUTCOMES = ("fine", "the program has an index that does not exist", "there is not enough memory",
            "the program is too large", "an argument is out of bounds", "the state is not finite",
            "an operation has no Taylor series", "a step with contacts is not found")  # fmt: skip
_ADDRESS, _LONG, _INT = ctypes.c_void_p, ctypes.c_int64, ctypes.c_int
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "tl_level": (_INT, []),
    "tl_program_new": (_INT, [_INT, _INT, _INT, _LONG, _ADDRESS, _INT, _ADDRESS, _INT, *[_ADDRESS] * 4]),
    "tl_program_free": (None, [_ADDRESS]),
    "tl_fits": (_INT, [_ADDRESS, _INT]),
    "tl_registers_new": (_ADDRESS, [_ADDRESS, _INT]),
    "tl_registers_free": (None, [_ADDRESS]),
    "tl_columns": (_INT, [_ADDRESS, _INT, _INT, _ADDRESS, _LONG, _INT, _ADDRESS, _INT, _ADDRESS]),
    "tl_method_new": (_INT, [_ADDRESS] * 9),
    "tl_method_free": (None, [_ADDRESS]),
    "tl_workspace_new": (_ADDRESS, [_ADDRESS, _INT]),
    "tl_workspace_free": (None, [_ADDRESS]),
    "tl_taylor_new": (_INT, [_ADDRESS, *[_INT] * 4, ctypes.c_double, _ADDRESS, _ADDRESS, ctypes.c_double, _ADDRESS]),
    "tl_taylor_free": (None, [_ADDRESS]),
    "tl_taylor_advance": (_LONG, [_ADDRESS, _INT, _LONG, _ADDRESS, _ADDRESS, _ADDRESS, _LONG, _ADDRESS]),
    "tl_contact_new": (_INT, [_ADDRESS, _LONG, _ADDRESS, _LONG, *[_ADDRESS] * 3, _INT, _ADDRESS, _INT, _ADDRESS]),
    "tl_contact_free": (None, [_ADDRESS]),
    "tl_contact_run": (_LONG, [_ADDRESS, _ADDRESS, *[_LONG] * 4, _ADDRESS, _LONG, _ADDRESS]),
    "tl_attempts": (_LONG, [_ADDRESS, _INT, _LONG, _LONG, _LONG, _ADDRESS, _ADDRESS]),
    "tl_ticks": (_LONG, [_ADDRESS, _INT, _LONG, _LONG, _ADDRESS, _ADDRESS, _ADDRESS]),
}
log = logging.getLogger("twolink")


def sources() -> list[Path]:
    """The files of C that the library is built from."""
    return sorted(FOLDER.rglob("*.[ch]"), key=Path.as_posix)


def digest() -> str:
    """A digest of the sources, which is built into the library."""
    content = hashlib.sha256()
    for file in sources():
        content.update(file.name.encode() + b"\0" + file.read_bytes().replace(b"\r\n", b"\n"))
    return content.hexdigest()[:16]


@functools.cache
def library() -> Any:
    """The library, or None where there is none or TWOLINK_NATIVE is 0: NumPy then runs all programs, slower.

    TWOLINK_NATIVE may also be the path of a library built in another way, as by `scripts.studies.suite`.
    Raises TwolinkError, code "native-library", for one that was built from other sources.
    """
    setting = os.environ.get("TWOLINK_NATIVE", "")
    if setting == "0":
        return None
    places = [Path(setting)] if setting else [FOLDER / name for name in NAMES]
    path = next((place for place in places if place.exists()), None)
    if path is None:
        log.warning("there is no native library beside %s: NumPy computes, slower; build it with pip install .", FOLDER)
        return None
    found = ctypes.CDLL(str(path))
    found.tl_sources.restype = ctypes.c_char_p
    built = found.tl_sources().decode()
    if built != digest():
        raise TwolinkError(f"the native library was built from other sources ({built}, not {digest()})",
                           where=str(path), remedy="pip install . (in a checkout: pip install -e .)",
                           code="native-library")  # fmt: skip
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(found, name)
        function.restype, function.argtypes = result, arguments
    return found


@functools.cache
def level() -> int:
    """The level of this processor: 2 with AVX-512, 1 with AVX2; TWOLINK_NATIVE_LEVEL lowers it."""
    return min(int(library().tl_level()), int(os.environ.get("TWOLINK_NATIVE_LEVEL", "9")))


def address(array: "np.ndarray[Any, Any] | None") -> int | None:
    """The address of an array's numbers."""
    return None if array is None else array.ctypes.data


def require(code: int, what: str) -> None:
    """Raise TwolinkError for an outcome that is not fine."""
    if code:
        raise TwolinkError(f"{what}: {OUTCOMES[abs(code)]}", remedy="report it, with the robot", code="native-library")


class Pool:
    """Objects that one thread at a time uses: taken and given back. Both are single operations of a list."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self._make, self._idle = make, list[Any]()

    def take(self) -> Any:
        """An object that nobody else has; to be given back."""
        try:
            return self._idle.pop()
        except IndexError:
            return self._make()

    def give(self, one: Any) -> None:
        """Give an object back."""
        self._idle.append(one)


class Handle:
    """Memory of the library, freed with this object."""

    def __init__(self, value: int | None, free: Callable[[int], None]) -> None:
        if not value:
            raise TwolinkError("there is not enough memory", remedy="fewer worlds at once", code="native-library")
        self.value = value
        weakref.finalize(self, free, value).atexit = False
