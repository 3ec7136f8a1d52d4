"""A robot's file read to its end: what strict reading refuses is collected, and left out of what is read."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import pinocchio as pin

from twolink.errors import RobotError, TwolinkError
from twolink.parts.lint.findings import Defect, Severity, defect
from twolink.parts.lint.shapes import Shapes
from twolink.robots.catalogue import Source, examples_share
from twolink.robots.formats import describe
from twolink.robots.load import build
from twolink.robots.meshes import mesh_folders
from twolink.robots.tree import VERSIONS, Tree, joined_tree
from twolink.robots.urdf import UrdfJoint, UrdfLink, read_joint, read_link
from twolink.robots.xml import Element, Foreign, Reader, Vector, foreign_content, parse_xml

_LOST = re.compile(r"Error opening file '(?:[^']*[\\/])?([^']*\.(?:obj|stl|msh|png))'", re.IGNORECASE)  # MuJoCo's words
_MOST = 1e60  # kg, m, rad, kg m^2: sums of squares of more overflow
Place = tuple[int, int]
"""The order of an element in its file, and its line."""
P = TypeVar("P", UrdfLink, UrdfJoint)


@dataclass(frozen=True)
class CollectingReader(Reader):
    """A reader that notes what is no number, and goes on with another."""

    wrong: list[RobotError] = field(default_factory=list)

    def numbers(self, element: Element, key: str, owner: str, count: int, default: Vector | None = None) -> Vector:
        """As `Reader.numbers`; 1, 0, 0, ... where they are wrong."""
        try:
            values = super().numbers(element, key, owner, count, default)
            if element.tag in ("mass", "inertia", "origin") and max(map(abs, values)) > _MOST:
                what = f'{key}="{element.attributes[key]}" is beyond all measure'
                raise self.error(element, owner, what, "give SI units")
            return values
        except RobotError as error:
            self.wrong.append(error)
            element.attributes[key] = " ".join(["1.0", *["0.0"] * (count - 1)])
            return (1.0, *[0.0] * (count - 1))


@dataclass(frozen=True)
class Reading:
    """A robot's file as far as it can be read.

    raw: its elements as they stand in it. links, joints: those that can be read. tree, model: None where they make no
    tree.
    """

    raw: Element
    links: Mapping[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]
    tree: Tree | None
    model: pin.Model | None
    shapes: Shapes
    found: tuple[Defect, ...]

    def line(self, element: Element | None, name: str) -> int:
        """The line of an element, or where the file first has the name, which macros may make in part."""
        if element is not None and element.line:
            return element.line
        names = dict.fromkeys((name, name.split("/")[0], name.removesuffix("_joint"), name.removesuffix("_fixed")))
        plain, macros = self._places
        for wanted in filter(None, names):
            places = [place for pattern, place in macros if pattern.fullmatch(wanted)]
            if wanted in plain:
                places.append(plain[wanted])
            if places:
                return min(places)[1]
        return 0

    @cached_property
    def _places(self) -> tuple[dict[str, Place], list[tuple[re.Pattern[str], Place]]]:
        """Places where each name first stands: by the name, and by patterns of those that macros make in part."""
        plain: dict[str, Place] = {}
        macros: list[tuple[re.Pattern[str], Place]] = []
        for order, part in enumerate(self.raw.inside()):
            written = re.split(r"\$\{.*?\}", part.attributes.get("name", ""))
            if len(written) == 1:
                plain.setdefault(written[0], (order, part.line))
            elif re.search("[a-zA-Z0-9]", "".join(written)):
                macros.append((re.compile(".*".join(map(re.escape, written))), (order, part.line)))
        return plain, macros

    @property
    def moving(self) -> tuple[UrdfJoint, ...]:
        """The joints that move."""
        return tuple(joint for joint in self.joints if joint.type != "fixed")


def read(source: Source, folders: list[Path], arguments: Mapping[str, object]) -> Reading | tuple[Defect, ...]:
    """The reading of a URDF, xacro or MJCF; the defects alone where nothing can be read.

    Raises
    ------
    MissingExtraError
        It is a xacro or an MJCF, and what expands or compiles it is not installed.
    """
    try:
        raw = parse_xml(source.data, source.label, source.encoding)
        said = describe(source, "report", "fixed", arguments, folders)
    except RobotError as error:
        if error.code == "mjcf" and (lost := _LOST.search(error.what)):
            return (lost_mesh(raw, lost[1], "error"),)
        return (of_error(error, "xml" if error.code == "xml" else "refused"),)
    if (tag := said.robot.tag) != "robot":
        piece: Severity | None = "note" if tag == "mujocoinclude" else None
        return (defect("xml", "", said.robot.line, f"the top element is <{tag}>", severity=piece),)
    if not said.robot.all("link"):  # a file of macros is none of a robot
        macros = source.path is not None and source.path.suffix == ".xacro"
        return (defect("tree", "", 0, "it has no link", severity="note" if macros else None),)
    robot, label, wrong = said.robot, source.label, list[Defect]()
    version = VERSIONS.get(robot.attributes.get("version", "1.0"), VERSIONS["1.0"])
    robot.attributes["version"] = "1.2" if version == (1, 2) else "1.1"
    reader, unknown = CollectingReader(label, version), list[RobotError]()
    foreign = foreign_content(reader, robot, refused=unknown)
    wrong += [of_error(error, "unknown-name" if "unknown" in error.what else "format") for error in unknown]
    links = _readable(reader, robot.all("link"), read_link, _without_inertia, wrong)
    joints = _readable(reader, robot.all("joint"), read_joint, _fixed, wrong)
    kept = [joint for joint in joints.values() if _is_joined(joint, links, wrong)]
    robot.children = [*(link.element for link in links.values()), *(joint.element for joint in kept)]
    tree, model = _joined(robot, links, kept, source, foreign, wrong, len(joints) > len(kept))
    shapes = Shapes(mesh_folders(folders, source.path, examples_share()))
    return Reading(raw, links, tree.joints if tree else tuple(kept), tree, model, shapes, tuple(wrong))


def lost_mesh(mujoco: Element, path: str, severity: Severity) -> Defect:
    """The defect that a mesh of an MJCF, or a picture, is not there."""
    name = re.split(r"[\\/]", path)[-1]
    lines = (part.line for part in mujoco.inside() if re.split(r"[\\/]", part.attributes.get("file", ""))[-1] == name)
    what = f"{name} is not there, and MuJoCo loads nothing without it"
    return defect("mesh-missing", "", next(lines, 0), what, "add the file", severity=severity)


def of_error(error: TwolinkError, rule: str) -> Defect:
    """The defect that strict reading refuses."""
    place = re.search(r":(\d+)", error.where)
    name = re.search(r"(?:link|joint) '([^']*)'", error.where)
    return defect(rule, name[1] if name else "", int(place[1]) if place else 0, error.what, error.remedy)


def _readable(reader: CollectingReader, elements: list[Element], read_one: Callable[[Reader, Element], P],
              repair: Callable[[Element], None], wrong: list[Defect]) -> dict[str, P]:  # fmt: skip
    """The links or joints by name, each that is wrong without what is wrong; a name that stands again is left out."""
    found: dict[str, P] = {}
    for element in elements:
        try:
            one = _one(reader, element, read_one, repair, wrong)
        except RobotError as error:
            wrong.append(of_error(error, "format"))
            continue
        if found.setdefault(one.name, one) is not one:
            wrong.append(defect("tree", one.name, element.line, f"<{element.tag}> has a name that is used before",
                                "rename one of them"))  # fmt: skip
    return found


def _one(reader: CollectingReader, element: Element, read_one: Callable[[Reader, Element], P],
         repair: Callable[[Element], None], wrong: list[Defect]) -> P:  # fmt: skip
    begun, failed = len(reader.wrong), None
    try:
        one = read_one(reader, element)
    except RobotError as error:
        failed = error
    numbers = reader.wrong[begun:]
    lacks = re.compile(r"<\w+> has no \w+")  # an attribute: what is not there is no number
    wrong += [of_error(error, "format" if lacks.fullmatch(error.what) else "number") for error in numbers]
    if failed is not None and failed.where not in {error.where for error in numbers}:
        wrong.append(of_error(failed, "format"))
    if failed is not None or numbers:
        repair(element)
        one = read_one(reader, element)
    return one


def _without_inertia(link: Element) -> None:
    """Give a link no inertia, so that nothing is said of it again."""
    zeros = dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), "0")
    parts = [Element("mass", {"value": "0"}, 0), Element("inertia", zeros, 0)]
    link.children = [Element("inertial", {"unread": "1"}, link.line, parts)]


def _fixed(joint: Element) -> None:
    """Fix a joint without an offset."""
    joint.attributes["type"] = "fixed"
    joint.children = [child for child in joint.children if child.tag in ("parent", "child")]


def _is_joined(joint: UrdfJoint, links: Mapping[str, UrdfLink], wrong: list[Defect]) -> bool:
    """True if both links of a joint exist."""
    lacking = [(tag, name) for tag, name in (("parent", joint.parent), ("child", joint.child)) if name not in links]
    for tag, name in lacking:
        wrong.append(defect("tree", joint.name, joint.element.line, f"{tag} link {name!r} does not exist",
                            "check the name, or add the link"))  # fmt: skip
    return not lacking


def _joined(robot: Element, links: dict[str, UrdfLink], joints: list[UrdfJoint], source: Source, foreign: Foreign,
            wrong: list[Defect], lacking: bool) -> tuple[Tree | None, Any]:  # fmt: skip
    """The tree, and Pinocchio's model of it."""
    tree = None
    try:
        if not links:
            return None, None  # each of them is a defect
        tree = joined_tree(robot, links, joints, source.label, foreign)
        return tree, build(tree, source.label, "fixed", mimic=False)
    except RobotError as error:
        if tree or not lacking:  # islands follow from joints that name no link
            wrong.append(of_error(error, "refused" if tree else "tree"))
        return tree, None
