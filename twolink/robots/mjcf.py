"""MJCF as the elements of a URDF: MuJoCo compiles it, and its bodies, joints and shapes become links and joints.

A body with several joints becomes a chain of links without mass. The coordinates stay MuJoCo's, but for quaternions
(x, y, z, w) and the velocity of a free body, which Pinocchio takes along the body's own axes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError
from twolink.robots.catalogue import Source
from twolink.robots.joint_layout import NO_LIMIT
from twolink.robots.load_report import Finding
from twolink.robots.load_report import findings as load_findings
from twolink.robots.mjcf_laws import effects_of, excluded, grounds, left_out, options_of, without_counterpart
from twolink.robots.mjcf_model import SHAPES, Mjcf, pose
from twolink.robots.model import FileLaws
from twolink.robots.srdf import Srdf
from twolink.robots.urdf import joint_element, written
from twolink.robots.xml import Element

_NOT_APPLIED = "laws beside the bodies (forward and inverse dynamics do not apply them; scene_of makes them effects)"
_JOINTS = ("floating", "spherical", "prismatic", "revolute")  # in the order of mjtJoint
DRAWN_GROUPS = 3  # MuJoCo's viewer draws groups 0 to 2 unless told otherwise


@dataclass(frozen=True)
class Description:
    """A robot as its file describes it.

    robot: a <robot> element. gravity (3,), m/s^2, if the file says it. laws: what acts besides forward dynamics.
    findings: for the load report. srdf: bodies that do not touch.
    """

    robot: Element
    gravity: tuple[float, ...] | None = None
    laws: FileLaws = field(default_factory=FileLaws)
    findings: tuple[Finding, ...] = ()
    srdf: Srdf = field(default_factory=Srdf)


def read_mjcf(mjcf: Mjcf, source: Source, foreign: str) -> Description:
    """Describe the robot of a compiled MJCF.

    Raises
    ------
    RobotError
        Code "no-counterpart": parts change the motion that twolink has not, unless foreign is "report".
    """
    model, missing = mjcf.model, without_counterpart(mjcf)
    if missing and foreign == "refuse":
        what, names = next(iter(missing.items()))
        more = f" (and {len(missing) - 1} more kinds of parts)" if len(missing) > 1 else ""
        raise RobotError(f"{what} changes the motion and has no counterpart{more}", where=f"{source.label}, {names[0]}",
                         code="no-counterpart", remedy='leave it out with foreign="report"')  # fmt: skip
    robot = Element("robot", {"name": model.names.split(b"\0")[0].decode() or source.label, "version": "1.1"}, 0)
    folder = None if source.path is None else Path.cwd()  # MuJoCo's paths are from there, if the model's is
    for body in range(model.nbody):
        robot.children += _elements(mjcf, body, folder)
    start = {name: _configuration(model, k) for k, name in enumerate(mjcf.joints)}
    gravity = tuple(0.0 if mjcf.is_off("GRAVITY") else float(g) for g in model.opt.gravity)
    changed = {f"{what} (changes the motion in MuJoCo)": names for what, names in missing.items()}
    laws = FileLaws(tuple(effects_of(mjcf)), start, options_of(mjcf), tuple(grounds(mjcf).values()))
    ignored = {
        _NOT_APPLIED: dict.fromkeys(kind for kind, _ in laws.effects),
        "ground (scene_of of the file has it with contact=True)": dict.fromkeys(kind for kind, _ in laws.grounds),
        **changed, **left_out(mjcf), **_meshes_left_out(mjcf, folder),
    }  # fmt: skip
    findings, apart = tuple(load_findings("ignored", ignored)), excluded(mjcf)
    return Description(robot, gravity, laws, findings, Srdf(apart, file=source.label if apart else ""))


def _configuration(model: Any, joint: int) -> tuple[float, ...]:
    """A joint's entries of qpos0 in Pinocchio's order."""
    kind, start = _JOINTS[model.jnt_type[joint]], model.jnt_qposadr[joint]
    q = [float(x) for x in model.qpos0[start : start + {"floating": 7, "spherical": 4}.get(kind, 1)]]
    return tuple(q if len(q) == 1 else [*q[:-4], *q[-3:], q[-4]])


def _elements(mjcf: Mjcf, body: int, folder: Path | None) -> Iterator[Element]:
    """The links and joints of a body: a chain where it has several joints, and its frame at the end.

    A joint turns about an anchor p of the body, from its reference q0: T(p) R(q - q0) T(-p).
    """
    model, name = mjcf.model, mjcf.bodies[body]
    link = Element("link", {"name": name}, 0, list(_inertial(model, body)))
    link.children += _shapes(mjcf, body, folder)
    if body == 0:
        yield link
        return
    parent, place = mjcf.bodies[model.body_parentid[body]], pose(model.body_pos[body], model.body_quat[body])
    joints = mjcf.joints_of(body)
    for k in joints:
        kind, axis, q0 = _JOINTS[model.jnt_type[k]], model.jnt_axis[k], float(model.qpos0[model.jnt_qposadr[k]])
        anchor = pin.SE3(np.eye(3), np.array(model.jnt_pos[k], dtype=float))
        if kind == "floating":
            place = anchor = pin.SE3.Identity()
        elif kind == "prismatic":
            place, anchor = place * pin.SE3(np.eye(3), -q0 * axis), pin.SE3.Identity()
        place = place * anchor
        if kind == "revolute":
            place = place * pin.SE3(pin.AngleAxis(-q0, axis).toRotationMatrix(), np.zeros(3))
        is_body = k == joints[-1] and anchor.isIdentity(0.0)
        child = name if is_body else f"{name}/{mjcf.joints[k]}"
        yield joint_element(mjcf.joints[k], kind, parent, child, _origin(place), *_properties(mjcf, k, kind))
        if not is_body:
            yield Element("link", {"name": child}, 0)
        parent, place = child, anchor.inverse()
    if parent != name:
        yield joint_element(f"{name}_fixed", "fixed", parent, name, _origin(place))
    yield link


def _origin(place: pin.SE3) -> Element:
    angles = pin.rpy.matrixToRpy(place.rotation)
    return Element("origin", {"xyz": written(place.translation), "rpy": written(angles)}, 0)


def _properties(mjcf: Mjcf, joint: int, kind: str) -> Iterator[Element]:
    """Axis, limits, damping, friction and armature of a joint."""
    m, dof = mjcf.model, mjcf.model.jnt_dofadr[joint]
    if kind in ("revolute", "prismatic"):
        yield Element("axis", {"xyz": written(m.jnt_axis[joint])}, 0)
        limited = m.jnt_limited[joint] and not mjcf.is_off("LIMIT", "CONSTRAINT")
        lower, upper = m.jnt_range[joint] if limited else (-NO_LIMIT, NO_LIMIT)
        limits = {"lower": lower, "upper": upper, "effort": _effort(mjcf, joint), "velocity": NO_LIMIT}
        yield Element("limit", {key: written(value) for key, value in limits.items()}, 0)
    one = kind in ("revolute", "prismatic")
    damping = m.dof_damping[dof] + mjcf.added_by_actuators("damping", joint) * one
    numbers = {
        "damping": 0.0 if mjcf.is_off("DAMPER") else damping,
        "friction": 0.0 if mjcf.is_off("FRICTIONLOSS", "CONSTRAINT") or not one else m.dof_frictionloss[dof],
        "armature": m.dof_armature[dof] * (kind != "floating") + mjcf.added_by_actuators("armature", joint) * one,
    }
    yield Element("dynamics", {key: written(value) for key, value in numbers.items()}, 0)


def _effort(mjcf: Mjcf, joint: int) -> float:
    """The largest torque of a joint's actuators; no limit where one of them has none, or there is none."""
    m, found = mjcf.model, mjcf.actuators_of(joint)
    largest = [_largest_force(m, k) for k in found] if len(m.actuator_trntype) == m.nu else []
    own = np.abs(m.jnt_actfrcrange[joint]).max() if m.jnt_actfrclimited[joint] else NO_LIMIT
    return float(min(own, sum(largest) if largest else NO_LIMIT, NO_LIMIT))


def _largest_force(m: Any, actuator: int) -> float:
    """The largest torque of an actuator on its joint: its limit, or that of its command times its gain."""
    gear = abs(m.actuator_gear[actuator, 0])
    if m.actuator_forcelimited[actuator]:
        return float(gear * np.abs(m.actuator_forcerange[actuator]).max())
    plain = m.actuator_gaintype[actuator] == m.actuator_biastype[actuator] == 0 and m.actuator_ctrllimited[actuator]
    command = np.abs(m.actuator_ctrlrange[actuator]).max() * abs(m.actuator_gainprm[actuator, 0])
    return float(gear * command) if plain else NO_LIMIT


def _inertial(m: Any, body: int) -> Iterator[Element]:
    """Mass and inertia of a body, with the principal axes of MuJoCo."""
    if m.body_mass[body] > 0:
        moments = dict.fromkeys(("ixy", "ixz", "iyz"), "0.0")
        moments |= dict(zip(("ixx", "iyy", "izz"), map(written, m.body_inertia[body]), strict=True))
        parts = [_origin(pose(m.body_ipos[body], m.body_iquat[body])),
                 Element("mass", {"value": written(m.body_mass[body])}, 0), Element("inertia", moments, 0)]  # fmt: skip
        yield Element("inertial", {}, 0, parts)


def _shapes(mjcf: Mjcf, body: int, folder: Path | None) -> Iterator[Element]:
    """The visuals and collisions of a body."""
    m, first = mjcf.model, int(mjcf.model.body_geomadr[body])
    for k in range(first, first + int(m.body_geomnum[body])):
        shape, place = _shape(m, k, folder), pose(m.geom_pos[k], m.geom_quat[k])
        own = mjcf.mesh_placement(int(m.geom_dataid[k])) if shape and shape.tag == "mesh" else pin.SE3.Identity()
        if shape is None or own is None:
            continue
        place = place * own
        parts = [_origin(place), Element("geometry", {}, 0, [shape])]
        if m.geom_group[k] < DRAWN_GROUPS:
            rgba = m.geom_rgba[k] if m.geom_matid[k] < 0 else m.mat_rgba[m.geom_matid[k]]
            colour = Element("material", {"name": f"geom{k}"}, 0, [Element("color", {"rgba": written(rgba)}, 0)])
            yield Element("visual", {}, 0, [*parts, colour])
        if m.geom_contype[k] or m.geom_conaffinity[k]:
            yield Element("collision", {}, 0, parts)


def _meshes_left_out(mjcf: Mjcf, folder: Path | None) -> dict[str, list[str]]:
    """Shapes whose mesh a URDF cannot name, by why not: they are neither drawn nor touched."""
    m, names = mjcf.model, mjcf.names("geom")
    meshes = [k for k in range(m.ngeom) if SHAPES.get(int(m.geom_type[k])) == "mesh"]
    without = [k for k in meshes if _shape(m, k, folder) is None]
    askew = [k for k in meshes if k not in without and mjcf.mesh_placement(int(m.geom_dataid[k])) is None]
    return {
        "meshes of no file, or of a model given as text (write them as files, and load the model by its path)":
            [names[k] for k in without],
        "meshes with refquat and a scale that is not the same along all axes (turn the vertices in the file)":
            [names[k] for k in askew],
    }  # fmt: skip


def _shape(m: Any, geom: int, folder: Path | None) -> Element | None:
    """A geom's shape; None where URDF has none such."""
    kind, size = SHAPES.get(int(m.geom_type[geom])), m.geom_size[geom]
    if kind == "mesh":
        mesh = m.geom_dataid[geom]
        at = int(m.mesh_pathadr[mesh])
        if at < 0 or folder is None:
            return None
        file = m.paths[at:].split(b"\0")[0].decode()
        return Element("mesh", {"filename": str(folder / file), "scale": written(m.mesh_scale[mesh])}, 0)
    sizes = {"sphere": {"radius": size[0]}, "box": {"size": 2 * size}}
    return None if kind is None else Element(kind, {key: written(value) for key, value in sizes.get(
        kind, {"radius": size[0], "length": 2 * size[1]}).items()}, 0)  # fmt: skip
