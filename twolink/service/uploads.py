"""Uploaded robots: a URDF, alone or in a zip with its meshes. Run in a worker process; nothing here is trusted.

A mesh may only come from the upload. Its names are rewritten so that they can mean nothing else, line by line as they
stand, so that errors keep their line numbers.
"""

from __future__ import annotations

import html
import posixpath
import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

from twolink.errors import RobotError, nearest
from twolink.robots.xml import Element, parse_xml

MESHES = (".stl", ".dae", ".obj")
_TEXTS = (".dae", ".mtl", ".obj")
_KEPT = (*MESHES, ".mtl", ".png", ".jpg", ".jpeg", ".urdf")
_LABEL = "upload"
_CHUNK = 2**20
_FILENAME = re.compile(r"""(\bfilename\s*=\s*)("([^"<]*)"|'([^'<]*)')""")
_POINTERS = re.compile(r"<init_from>\s*(?:<ref>)?\s*([^<\s][^<]*?)\s*<|^\s*(?:map_\w+|bump|disp|decal|mtllib)\s+(.*)$",
                       re.MULTILINE)  # fmt: skip


def unpack(archive: Path, folder: Path, *, most_bytes: int, most_files: int) -> list[str]:
    """Unpack the robots and meshes of a zip into an empty folder. Returns their names. Raises RobotError."""
    try:
        with zipfile.ZipFile(archive) as opened:
            members = [m for m in opened.infolist() if not m.is_dir()]
            if len(members) > most_files:
                raise _refused(
                    f"{len(members)} files, the limit is {most_files}", "leave out what the URDF does not use"
                )
            if sum(m.file_size for m in members) > most_bytes:
                raise _refused(f"more than {most_bytes} bytes unpacked", "simplify the meshes")
            left, names = most_bytes, []
            for member in members:
                name = _safe(member.filename)
                if name.lower().endswith(_KEPT) and name not in names:
                    left -= _copy(opened, member, folder / name, left)
                    names.append(name)
            return names
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, ValueError) as error:
        raise _refused(f"it is not a zip that can be read: {error}", "pack it again, without a password") from None
    except OSError as error:
        raise _refused(f"it cannot be unpacked: {error.strerror or error}", "use short, plain file names") from None


def _safe(name: str) -> str:
    """The name of a member, which must stay inside. Links are no danger: all members become plain files."""
    parts = name.split("/")
    if name.startswith("/") or "\\" in name or ":" in parts[0] or "\0" in name or ".." in parts or "." in parts:
        raise _refused(f"{name[:80]!r} points outside the zip", "use names below its top folder")
    return name


def _copy(opened: zipfile.ZipFile, member: zipfile.ZipInfo, target: Path, left: int) -> int:
    """Unpack one file, counting what really comes out of it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    size = 0
    with opened.open(member) as source, target.open("wb") as out:
        while chunk := source.read(_CHUNK):
            size += len(chunk)
            if size > min(left, member.file_size):
                raise _refused(f"{member.filename[:80]!r} is larger than it says", "pack it again")
            out.write(chunk)
    return size


def choose_urdf(names: list[str], wanted: str) -> str:
    """The URDF among the files: the one that is named, or the only one."""
    found = [name for name in names if name.lower().endswith(".urdf")]
    if wanted:
        if wanted not in found:
            raise _refused(f"there is no {wanted[:80]!r} in it", nearest(wanted, found))
        return wanted
    if len(found) != 1:
        what = f"{len(found)} URDFs are in it, expected one"
        raise _refused(what, f"say which: ?urdf={found[0]}" if found else "its name must end in .urdf")
    return found[0]


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

    Names of files that are not in it stay unknown, and the load report lists them. Raises RobotError for names that
    point outside: file://, other schemes, absolute paths, and too many "..".
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
    """package:// and the file's place in the upload, where it is found; else a name that is nowhere."""
    if name.startswith("package://"):
        inside = name.removeprefix("package://")
        if ".." in inside.split("/"):
            return name  # refused by what follows
        wanted = [inside, inside.partition("/")[2]]
    elif "://" in name or name.startswith("/"):
        return name
    else:
        inside = posixpath.normpath(posixpath.join(posixpath.dirname(urdf), name))
        if inside.startswith(".."):
            return name
        wanted = [inside]
    base = posixpath.dirname(urdf)
    while True:
        for candidate in (posixpath.join(base, part) for part in wanted):
            if candidate in names and candidate.lower().endswith(MESHES):
                return f"package://{candidate}"
        if not base:
            # A folder that no package has: what is not in the upload is not looked for elsewhere either.
            return name if name.startswith("package://example-robot-data/") else f"package://not-uploaded/{inside}"
        base = posixpath.dirname(base)


def _is_local(name: str) -> bool:
    return name.startswith("package://") and ".." not in name.split("/") and "\\" not in name and "\0" not in name


def _elements(element: Element) -> Iterator[Element]:
    yield element
    for child in element.children:
        yield from _elements(child)


def _refused(what: str, remedy: str, name: str = "") -> RobotError:
    return RobotError(what, where=f"{_LABEL}: {name}" if name else _LABEL, remedy=remedy)
