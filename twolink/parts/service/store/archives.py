"""Content as bytes: robots between processes, and zips and arrays that are not trusted; and kept robots.

Every size is checked before memory is taken for it. A mesh may only come from the upload, and its materials and
pictures only from the folder of the mesh. That is required where the files are opened (`io.confined`), whatever the
names look like.

Measured on 3 arrays of 100,000 x 9 numbers: written in 13 ms (numpy.savez: 45 ms), read in 16 ms (NumPy's own reading
of the members: 25 ms).

Reading them runs no code but that of a robot's own parts. A worker process may have been taken over by what it read;
plain `pickle.loads` of its answer would run whatever the answer names, outside the sandbox. (That bytes which are none
of Pinocchio's harm its reader is not excluded.)
"""

import io
import math
import pickle
import zipfile
import zlib
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.errors import RobotError, nearest
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas
from twolink.robots.catalogue import examples_share
from twolink.robots.load_report import Finding, LoadReport
from twolink.robots.meshes import MeshFile, MeshFolders
from twolink.robots.model import FileLaws, Visuals, restore_model
from twolink.robots.srdf import Srdf

_KEPT = (".stl", ".dae", ".obj", ".mtl", ".png", ".jpg", ".jpeg", ".urdf")
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # of zips; others take memory by what the archive says
GZIP_LEVEL = 5
NPZ = "application/x-npz"
_MAX_ARRAYS = 64
_MAX_AXES = 16
_HEADER = 10_000  # bytes a .npy header may take
_END, _ZIP64_LOCATOR = 22, 20  # bytes of the records at the end of a zip
_MAX_DIRECTORY = 64 * 1024  # bytes of a zip's list of members


def unpack(archive: Path, folder: Path, quotas: Quotas, room: Callable[[int], None]) -> list[str]:
    """Unpack the robots and meshes of a zip into an empty folder. Returns their names. Raises RobotError.

    room: called with the bytes that it will take, before.
    """
    try:
        with zipfile.ZipFile(archive) as opened:
            members = [member for member in opened.infolist() if not member.is_dir()]
            if len(members) > quotas.files:
                raise _refused(f"{len(members)} files, the limit is {quotas.files}", "send only files the URDF uses")
            if any(member.compress_type not in METHODS for member in members):
                raise _refused("a file in it is neither stored nor deflated", "pack it again, as plain zip")
            if sum(member.file_size for member in members) > quotas.upload_mb * 2**20:
                raise _refused(f"more than {quotas.upload_mb:g} MB unpacked", "simplify the meshes")
            by_name = {_safe(member.filename): member for member in reversed(members)}
            names = [name for name in by_name if name.lower().endswith(_KEPT)]
            room(sum(by_name[name].file_size for name in names))
            for name in names:
                opened.extract(by_name[name], folder)  # not more bytes than it states: their checksum is wrong then
            return names
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, ValueError) as error:
        raise _refused(f"it is not a zip that can be read: {error}", "pack it again, without a password") from None
    except OSError as error:
        raise _refused(f"it cannot be unpacked: {error.strerror or error}", "use short, plain file names") from None


def _safe(name: str) -> str:
    """The name of a member, which must stay inside. Links do no harm: all members become plain files."""
    parts = name.split("/")
    if name.startswith("/") or "\\" in name or ":" in parts[0] or "\0" in name or not {".", ".."}.isdisjoint(parts):
        raise _refused(f"{name[:80]!r} points outside the zip", "use names below its top folder")
    return name


def choose_urdf(names: list[str], wanted: str) -> str:
    """The URDF among the files: the one that is named, or the only one."""
    urdfs = sorted(name for name in names if name.lower().endswith(".urdf"))
    if wanted:
        if wanted not in urdfs:
            raise _refused(f"there is no {wanted[:80]!r} in it", nearest(wanted, urdfs))
        return wanted
    if len(urdfs) != 1:
        if not urdfs:
            raise _refused("no URDF is in it", "the name of one must end in .urdf")
        what, remedy = f"{len(urdfs)} URDFs are in it, expected one", f"say which: ?urdf={urdfs[0]}"
        raise RobotError(what, where="upload", remedy=remedy, code="several-urdfs", urdfs=urdfs)
    return urdfs[0]


def upload_folders(files: Path, urdf: str) -> MeshFolders:
    """Folders searched for the meshes of an upload: its folder `files`, from the URDF's place in it upwards.

    Those of example-robot-data are found too; nothing else is.
    """
    share = examples_share()
    base = (files / urdf).parent
    above = [folder for folder in (base, *base.parents) if folder.is_relative_to(files)]
    roots = (files, *([] if share is None else [share / "example-robot-data"]))
    return MeshFolders((*above, *([] if share is None else [share])), base, roots)


def _refused(what: str, remedy: str) -> RobotError:
    return RobotError(what, where="upload", remedy=remedy)


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


_PARTS = (Robot, pin.Model, LoadReport, Finding, Visuals, FileLaws, Srdf, MeshFile, type(Path()), np.ndarray, np.dtype)
_NAMES = {
    **{(part.__module__, part.__qualname__): part for part in _PARTS},
    (restore_model.__module__, restore_model.__name__): restore_model,
    ("numpy._core.multiarray", "_reconstruct"): np.zeros(0).__reduce__()[0],
}


def write_robot(robot: Robot) -> bytes:
    """The robot, for `read_robot`."""
    return pickle.dumps(robot)


def read_robot(content: bytes) -> Robot:
    """The robot that `write_robot` has written.

    Raises
    ------
    pickle.UnpicklingError
        The content names something that is no part of a robot.
    """
    robot = _Unpickler(io.BytesIO(content)).load()
    if not isinstance(robot, Robot):
        raise pickle.UnpicklingError(f"expected a robot, got a {type(robot).__name__}")
    return robot


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _NAMES:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of a robot")
        return _NAMES[module, name]


class RobotCache:
    """Robots by key. One that is dropped lives on for those who use it."""

    def __init__(self, megabytes: float) -> None:
        self._limit, self._bytes = megabytes * 2**20, 0
        self._robots: OrderedDict[str, Robot] = OrderedDict()

    def get(self, key: str) -> Robot | None:
        """The robot of this key if it is there."""
        robot = self._robots.get(key)
        if robot is not None:
            self._robots.move_to_end(key)
        return robot

    def put(self, key: str, robot: Robot) -> Robot:
        """Keep a robot, the newest even where it alone is above the limit."""
        self.drop(key)
        self._robots[key] = robot
        self._bytes += memory_of(robot)
        while self._bytes > self._limit and len(self._robots) > 1:
            self.drop(next(iter(self._robots)))
        return robot

    def drop(self, key: str) -> None:
        """Forget a robot, if it is there."""
        robot = self._robots.pop(key, None)
        if robot is not None:
            self._bytes -= memory_of(robot)


def memory_of(robot: Robot) -> int:
    """Bytes of a robot that answers queries, about: nearly all is Pinocchio's data, four tensors of nv^3 numbers.

    Measured: chains of 5, 20, 40 and 100 joints have data of 0.07, 0.5, 2.2 and 22 to 33 MB.
    """
    return 2 * len(robot.visuals.text) + 2**17 + 32 * robot.nv**3
