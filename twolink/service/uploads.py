"""Uploaded robots: a URDF, alone or in a zip with its meshes. This runs in a worker process and trusts nothing.

A mesh may only come from the upload. File names in the URDF are rewritten to package:// and the place in the upload;
lines stay as they are, so that errors name the right line.
"""

import html
import posixpath
import re
import zipfile
import zlib
from pathlib import Path
from xml.sax.saxutils import escape

from twolink.errors import RobotError, nearest
from twolink.robots.xml import Element, parse_xml
from twolink.service.settings import Quotas

_MESHES = (".stl", ".dae", ".obj")
_TEXTS = (".dae", ".mtl", ".obj")
_KEPT = (*_MESHES, ".mtl", ".png", ".jpg", ".jpeg", ".urdf")
_CHUNK = 2**20
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # of zips; others take memory by what the archive says
_FILENAME = re.compile(r"""(\bfilename\s*=\s*)("([^"<]*)"|'([^'<]*)')""")
_POINTERS = re.compile(r"<init_from>\s*(?:<ref>)?\s*([^<\s][^<]*?)\s*<|^\s*(?:map_\w+|bump|disp|decal|mtllib)\s+(.*)$",
                       re.MULTILINE)  # fmt: skip


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
    urdfs = [name for name in names if name.lower().endswith(".urdf")]
    if wanted:
        if wanted not in urdfs:
            raise _refused(f"there is no {wanted[:80]!r} in it", nearest(wanted, urdfs))
        return wanted
    if len(urdfs) != 1:
        remedy = f"say which: ?urdf={urdfs[0]}" if urdfs else "its name must end in .urdf"
        raise _refused(f"{len(urdfs)} URDFs are in it, expected one", remedy)
    return urdfs[0]


def check_files(folder: Path, names: list[str]) -> None:
    """Refuse mesh files that point at files outside the upload, or that declare entities."""
    for name in names:
        if not name.lower().endswith(_TEXTS):
            continue
        text = (folder / name).read_bytes().decode("utf-8", errors="replace")
        if name.lower().endswith(".dae") and ("<!DOCTYPE" in text or "<!ENTITY" in text or "\0" in text):
            raise _refused("a DOCTYPE is refused", "remove it", name)
        for match in _POINTERS.finditer(text):
            pointed = html.unescape(match.group(1) or match.group(2)).strip()
            if pointed.startswith(("/", "~", "\\")) or ".." in pointed or ":" in pointed or "%" in pointed:
                raise _refused(f"it points outside the upload: {pointed[:80]!r}", "put that file beside it", name)


def local_urdf(text: str, urdf: str, names: list[str]) -> str:
    """The URDF's text with each mesh as package:// and its place in the upload.

    Files that are not in the upload are listed as missing in the load report. Raises RobotError for names that point
    outside: file://, other schemes, absolute paths, and too many "..".
    """

    def replaced(match: re.Match[str]) -> str:
        name = html.unescape(match.group(3) if match.group(3) is not None else match.group(4))
        return match.group(1) + '"' + escape(_local(name, urdf, names), {'"': "&quot;"}) + '"'

    rewritten = _FILENAME.sub(replaced, text)
    for element in _elements(parse_xml(rewritten.encode(), "URDF text", "utf-8")):
        name = element.attributes.get("filename", "")
        if name and element.tag in ("mesh", "texture") and not _is_local(name):
            what = f"the file name {name[:80]!r} points outside the upload"
            raise RobotError(what, where=f"URDF text:{element.line}", remedy="use package://... or a relative name")
    return rewritten


def _local(name: str, urdf: str, names: list[str]) -> str:
    """package:// and the file's place in the upload; a name outside the upload stays, and is refused afterwards."""
    folder = posixpath.dirname(urdf)
    inside = name.removeprefix("package://")
    if inside != name:
        candidates = [inside, inside.partition("/")[2]]
    elif "://" in name or name.startswith("/"):
        return name
    else:
        inside = posixpath.normpath(posixpath.join(folder, name))
        candidates = [inside]
    if ".." in inside.split("/"):
        return name
    while True:
        for candidate in (posixpath.join(folder, part) for part in candidates):
            if candidate in names and candidate.lower().endswith(_MESHES):
                return f"package://{candidate}"
        if not folder:  # no package has the folder "not-uploaded": what is missing is not looked for elsewhere
            return name if name.startswith("package://example-robot-data/") else f"package://not-uploaded/{inside}"
        folder = posixpath.dirname(folder)


def _is_local(name: str) -> bool:
    return name.startswith("package://") and ".." not in name.split("/") and "\\" not in name and "\0" not in name


def _elements(element: Element) -> list[Element]:
    return [element, *(inner for child in element.children for inner in _elements(child))]


def _refused(what: str, remedy: str, name: str = "") -> RobotError:
    return RobotError(what, where=f"upload: {name}" if name else "upload", remedy=remedy)
