"""Uploaded robots: a URDF, alone or in a zip with its meshes. This runs in a worker process and trusts nothing.

A mesh may only come from the upload, and its materials and pictures only from the mesh's folder. That is required
where the files are opened (`io.confined`), whatever the names look like.
"""

import zipfile
import zlib
from pathlib import Path

from twolink.errors import RobotError, nearest
from twolink.robots.catalogue import examples_share
from twolink.robots.meshes import MeshFolders
from twolink.service.settings import Quotas

_KEPT = (".stl", ".dae", ".obj", ".mtl", ".png", ".jpg", ".jpeg", ".urdf")
_CHUNK = 2**20
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # of zips; others take memory by what the archive says


def unpack(archive: Path, folder: Path, quotas: Quotas) -> list[str]:
    """Unpack the robots and meshes of a zip into an empty folder. Returns their names. Raises RobotError."""
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
            for name in names:
                _copy(opened, by_name[name], folder / name)
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


def _copy(opened: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path) -> None:
    """Unpack one file, and refuse it when more bytes come out of it than the zip states."""
    target.parent.mkdir(parents=True, exist_ok=True)
    size = 0
    with opened.open(member) as source, target.open("wb") as out:
        while chunk := source.read(_CHUNK):
            size += len(chunk)
            if size > member.file_size:
                raise _refused(f"{member.filename[:80]!r} is larger than it says", "pack it again")
            out.write(chunk)


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
    """Where the meshes of an upload are looked for: in its folder `files`, from the URDF's place in it upwards.

    Those of example-robot-data are found too; nothing else is.
    """
    share = examples_share()
    base = (files / urdf).parent
    above = [folder for folder in (base, *base.parents) if folder.is_relative_to(files)]
    roots = (files, *([] if share is None else [share / "example-robot-data"]))
    return MeshFolders((*above, *([] if share is None else [share])), base, roots)


def _refused(what: str, remedy: str) -> RobotError:
    return RobotError(what, where="upload", remedy=remedy)
