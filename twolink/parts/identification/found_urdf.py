"""A URDF with the parameters that were found: the file as it was, new values, and a comment on each."""

import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import body_names
from twolink.dynamics.regressors import JOINT_PARAMETERS
from twolink.errors import RobotError
from twolink.io.files import path_to_write, write_atomic
from twolink.parts.identification.fit_result import SceneFit
from twolink.parts.identification.result import Identification
from twolink.robots.catalogue import open_source
from twolink.robots.checks import is_impossible
from twolink.robots.tree import Tree, read_tree
from twolink.robots.urdf import moments_written, written
from twolink.robots.xml import parse_xml

Found = Identification | SceneFit
_HEAD = re.compile(r"(?:\s|<\?.*?\?>|<!--.*?-->)*", re.DOTALL)  # what comes before <robot>


def write_urdf(found: Found, source: str | os.PathLike[str], path: str | os.PathLike[str]) -> Path:
    """Write the URDF of `source` with what was found.

    Parameters
    ----------
    found : Identification or SceneFit
        What was found; the parameters of the robot `found.found` are written. Numbers of effects have no place in a
        URDF: `SceneFit.scene.save` keeps them.
    source : str or path
        The name, path or URDF text that the robot was loaded from.
    path : str or path
        The file to write.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    RobotError
        Code "other-robot": the source has not the links and joints of the robot.
    TwolinkError
        The file cannot be written.
    """
    urdf = open_source(source)
    tree = read_tree(parse_xml(urdf.data, urdf.label, urdf.encoding), urdf.label, foreign="report", xacro="ignore")
    root = ET.fromstring(urdf.data, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    model, new = found.robot.model, found.found.model
    changed = found.found.parameter_values - found.robot.parameter_values
    for j, link in enumerate(body_names(model)[1:]):
        change = changed[10 * j : 10 * j + 10]
        if any(name.startswith(f"{link}.") for name in found.parameters):
            element = _named(root, "link", link, urdf.label)
            own, absorbed = _body_of(tree, model, link, change)
            _set_inertial(element, own)
            _comment(element, _remarks(found, link))
            for other in absorbed:
                _move_inertial(_named(root, "link", other, urdf.label), link)
    for joint in model.names[1:]:
        kinds = [kind for kind in JOINT_PARAMETERS if f"{joint}.{kind}" in found.parameters]
        if kinds:
            element = _named(root, "joint", joint, urdf.label)
            dof = model.idx_vs[model.getJointId(joint)]
            values = {"damping": new.damping[dof], "friction": new.upperDryFrictionLimit[dof],
                      "armature": new.armature[dof]}  # fmt: skip
            dynamics = _child(element, "dynamics")
            for kind in kinds:
                dynamics.set(kind, repr(float(values[kind])))
            if list(dynamics.keys()) == ["armature"]:  # which other programs leave out, and refuse what is empty then
                dynamics.set("damping", "0.0")
            _comment(element, _remarks(found, joint))
    head = _HEAD.match(urdf.data.decode("utf-8-sig"))
    text = (head.group() if head else "") + ET.tostring(root, encoding="unicode") + "\n"
    return write_atomic(path_to_write(path), lambda file: file.write(text.encode()), error=RobotError)


def _named(root: ET.Element, tag: str, name: str, label: str) -> ET.Element:
    """The link or joint of this name. Raises RobotError."""
    for element in root.findall(tag):
        if element.get("name") == name:
            return element
    raise RobotError(f"it has no {tag} {name!r}", where=label, code="other-robot",
                     remedy="give the source that the robot was loaded from")  # fmt: skip


def _own_parameters(tree: Tree, name: str) -> np.ndarray:
    """The ten parameters of a link alone, without the links that are fixed to it, in its frame."""
    link = tree.links[name]
    inertial = link.element.first("inertial")
    origin = None if inertial is None else inertial.first("origin")
    lever = [float(x) for x in (origin.attributes.get("xyz", "0 0 0") if origin else "0 0 0").split()]
    return np.asarray(pin.Inertia(link.mass, np.array(lever), link.inertia).toDynamicParameters())


def _body_of(tree: Tree, model: pin.Model, link: str, change: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """The ten parameters of a link alone after a change, and links whose own are in them.

    Links that are fixed to it keep theirs, unless no body has what that leaves to the link.
    """
    own, fixed = _own_parameters(tree, link) + change, [link]
    if _exists(own):
        return own, []
    for joint in tree.joints:  # parents come before their children
        if joint.type == "fixed" and joint.parent in fixed:
            fixed.append(joint.child)
    heavy, whole = [name for name in fixed[1:] if tree.links[name].mass > 0.0], own.copy()
    for name in heavy:
        place = model.frames[model.getFrameId(name, pin.FrameType.BODY)].placement
        whole += place.act(pin.Inertia.FromDynamicParameters(_own_parameters(tree, name))).toDynamicParameters()
    return (whole, heavy) if _exists(whole) else (own, [])


def _exists(parameters: np.ndarray) -> bool:
    """True if a body has these ten parameters."""
    if not parameters[0] > 0.0:
        return False
    return not is_impossible(pin.Inertia.FromDynamicParameters(parameters).inertia, float(parameters[0]))


def _move_inertial(link: ET.Element, to: str) -> None:
    """Remove the inertia of a link that is in that of another one, and say so."""
    inertial = link.find("inertial")
    if inertial is not None:
        link.remove(inertial)
    _comment(link, [f"its mass is in {to}, to which it is fixed: no body has what was found without it"])


def _set_inertial(link: ET.Element, parameters: np.ndarray) -> None:
    """Write the ten parameters, the inertia about the centre of mass along the link's axes."""
    body = pin.Inertia.FromDynamicParameters(parameters)
    inertial = _child(link, "inertial")
    for tag, values in (
        ("origin", {"xyz": written(body.lever), "rpy": "0 0 0"}),
        ("mass", {"value": repr(float(body.mass))}),
        ("inertia", moments_written(body.inertia)),
    ):
        part = _child(inertial, tag)
        part.attrib.clear()
        part.attrib.update(values)


def _child(parent: ET.Element, tag: str) -> ET.Element:
    """The first child of this tag; a new one, indented as the others, where there is none."""
    found = parent.find(tag)
    if found is None:
        found = ET.Element(tag)
        if len(parent):
            parent[-1].tail, found.tail = parent.text, parent[-1].tail
        parent.append(found)
    return found


def _remarks(found: Found, owner: str) -> list[str]:
    """A line for each combination that a link or joint is part of, and for what could not be told of it."""
    percent = f"{100 * found.confidence:g} %"
    parameters = tuple(found.parameters)
    names = [k for k, name in enumerate(parameters) if name.startswith(f"{owner}.")]
    lines = []
    for text, row, (low, high) in zip(found.combinations, found.matrix, found.intervals.values(), strict=True):
        if np.any(row[names]):
            lines.append(f"found: {text} = {(low + high) / 2:.6g}, {percent} within {low:.6g} and {high:.6g}")
    unseen = [parameters[k] for k in names if not np.any(found.matrix[:, k])]
    return [*lines, *([f"not seen in the data, kept near its value: {', '.join(unseen)}"] if unseen else [])]


def _comment(element: ET.Element, lines: list[str]) -> None:
    """Put lines as comments at the head of an element; XML forbids two hyphens in them."""
    for k, line in enumerate(lines):
        comment = ET.Comment(f" {line.replace('--', '- -')} ")
        comment.tail = element.text
        element.insert(k, comment)
