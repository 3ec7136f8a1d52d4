"""Descriptions of robots from files of any format, as elements of a URDF: xacro is expanded, MJCF compiled."""

import re
import threading
from collections.abc import Iterable, Mapping, Sequence, Set
from pathlib import Path

from twolink.errors import RobotError, import_extra, nearest
from twolink.io.files import confining_roots
from twolink.robots.catalogue import Source
from twolink.robots.mjcf import Description, read_mjcf
from twolink.robots.mjcf_files import require_readable
from twolink.robots.mjcf_model import compiled_mjcf
from twolink.robots.tree import LEAVE_OUT, xacro_element
from twolink.robots.xml import Element, parse_xml

_xacro_lock = threading.Lock()  # xacro keeps its state in its modules
_USD = (b"PXR-USDC", b"#usda", b"PK\3\4")
# What converts a file into one that is read.
_CONVERTERS = {
    "SDF": "convert it where Gazebo's Python bindings sdformat13 and gz.math7 are installed, which PyPI has not: "
           "pip install sdformat-mjcf, then sdf2mjcf {} robot.xml, and load robot.xml",
    "USD": "pip install nvidia-srl-usd-to-urdf, then usd_to_urdf {} -o robot.urdf, and load robot.urdf",
}  # fmt: skip


def describe(
    source: Source, foreign: str, root: str, xacro_arguments: Mapping[str, object], folders: Iterable[Path], *,
    trusted: bool = True, xacro: str = "expand",
) -> Description:  # fmt: skip
    """Describe a robot by the file of a source.

    Parameters
    ----------
    source : Source
        A URDF, an MJCF, or the file of a xacro.
    foreign : {"refuse", "report"}
        Whether an MJCF may have parts that change the motion and that twolink has not.
    root : {"fixed", "free"}
        Whether the base moves freely, which an MJCF itself says.
    xacro_arguments : mapping
        Of a xacro.
    folders : iterable of Path
        Where a xacro finds packages, besides the folders above it.
    trusted : bool
        Whether other files that an MJCF names may be opened.
    xacro : {"expand", "ignore"}
        Expand a file that has xacro, or take it as it is.

    Raises
    ------
    RobotError
        It is none of these, or is refused.
    """
    if source.data.startswith(_USD):
        raise _other_format("USD", source.label)
    element = parse_xml(source.data, source.label, source.encoding)
    if element.tag == "sdf":
        raise _other_format("SDF", source.label)
    if element.tag == "mujoco":
        if not trusted:
            raise RobotError("an MJCF may open other files", where=source.label, code="urdf",
                             remedy="load it where it is, and send what robot.export_urdf writes")  # fmt: skip
        if root == "free":
            raise RobotError("an MJCF itself says which bodies are free", where=source.label, argument="root",
                             remedy="give the body a <freejoint/>")  # fmt: skip
        require_readable(source, element)
        return read_mjcf(compiled_mjcf(source), source, foreign)
    if xacro == "expand" and source.path is not None and xacro_element(element) is not None:
        if confining_roots() is not None:
            raise RobotError("it is xacro, which can hold code", where=source.label, code="not-allowed",
                             remedy='xacro="ignore", or expand it: xacro FILE > robot.urdf')  # fmt: skip
        parents = source.path.resolve().parents
        # Arguments that the file declares, those of conditions that do not hold too.
        declared = {one.attributes.get("name", "") for one in element.inside() if one.tag == "xacro:arg"}
        element = _expanded(source.path, source.label, xacro_arguments, [*folders, *parents], declared)
    elif xacro_arguments:
        what = "no xacro is expanded that could take arguments"
        raise RobotError(what, where=source.label, argument="xacro_arguments", remedy="leave them out")
    return Description(element)


def _other_format(name: str, label: str) -> RobotError:
    return RobotError(f"it is {name}, which is not read", where=label, remedy=_CONVERTERS[name].format(label),
                      code="other-format")  # fmt: skip


class _Arguments(dict[str, str]):
    """Arguments of a xacro, and the names that it asks for."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)


def _expanded(
    path: Path, label: str, arguments: Mapping[str, object], folders: Sequence[Path], declared: Set[str]
) -> Element:
    """The <robot> that a xacro file stands for. Raises RobotError (code "xacro") with file and line."""
    xacro, names = import_extra("xacro", "xacro"), import_extra("xacro.substitution_args", "xacro")
    with _xacro_lock:
        found, names._eval_find = names._eval_find, lambda package: _package(package, folders)
        try:
            mappings = _Arguments({name: str(value) for name, value in arguments.items()})
            text = xacro.process_file(str(path), mappings=mappings).toxml()
        except Exception as error:  # xacro raises errors of any type
            files = [macro.history[-1][-1] for macro in reversed(xacro.macrostack or [])] + xacro.filestack[::-1]
            cause = getattr(error, "exc", None)
            what = " ".join(str(cause if isinstance(cause, FileNotFoundError) else error).split())
            remedy = "correct it, or give xacro_arguments=, or the folders of packages by package_dirs="
            remedy += f"; of a finished URDF, {LEAVE_OUT}"
            raise RobotError(f"xacro: {what or type(error).__name__}", code="xacro", remedy=remedy,
                             where=_place(what, files, getattr(error, "lineno", None))) from None  # fmt: skip
        finally:
            names._eval_find = found
    known = mappings.asked | declared
    for name in arguments:
        if name not in known:
            raise RobotError(f"the xacro asks for no argument {name!r}", where=label, argument="xacro_arguments",
                             remedy=nearest(name, sorted(known)), code="xacro")  # fmt: skip
    return _unplaced(parse_xml(text.encode(), label, "utf-8"))


def _unplaced(element: Element) -> Element:
    """The element with no lines: those of the expanded text are not in the file."""
    return Element(element.tag, element.attributes, 0, list(map(_unplaced, element.children)), element.has_text)


def _package(name: str, folders: Sequence[Path]) -> str:
    """The folder of a package: one of its name, or one, in a folder or itself, whose package.xml has its name."""
    for folder in folders:
        if (folder / name).is_dir():
            return str(folder / name)
        for manifest in (folder / "package.xml", *folder.glob("*/package.xml")):
            if manifest.is_file() and f"<name>{name}</name>" in manifest.read_text("utf-8", "replace"):
                return str(manifest.parent)
    raise FileNotFoundError(f"package '{name}' is not found")


def _place(what: str, files: Sequence[str], line: int | None) -> str:
    """The file and the line of a fault in a xacro: the first line with the last text that the message quotes."""
    quoted = ["".join(pair) for pair in re.findall(r"'([^']+)'|\"([^\"]+)\"", what)]
    for text in [] if line else [f"$(arg {what.rpartition(' ')[2]})", *reversed(quoted)]:
        for file in dict.fromkeys(files):
            for number, content in enumerate(Path(file).read_text("utf-8", "replace").splitlines(), 1):
                if text in content:
                    return f"{file}:{number}"
    return f"{files[0]}:{line}" if line else files[0]
