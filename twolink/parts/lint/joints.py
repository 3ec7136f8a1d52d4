"""Checks of joints and meshes: axes, limits, damping, mimic joints, scales, and the unit of angles in an MJCF."""

import math
from collections.abc import Iterator

import numpy as np

from twolink.parts.lint.findings import Defect, Fix, defect
from twolink.parts.lint.reading import Reading, lost_mesh
from twolink.parts.lint.shapes import floats, meshes, placement
from twolink.robots.checks import mimic_fault
from twolink.robots.meshes import missing_meshes
from twolink.robots.tree import other_side
from twolink.robots.urdf import UNIT_TOLERANCE, UrdfJoint
from twolink.robots.xml import Element

_ROUNDING = 1e-6  # of an axis, as in the load report
_NONE = 1e9  # N m, rad/s: numbers from here on say that there is no limit
_STRONG, _FAST = 1e5, 90.0  # N m or N; rad/s
_OUTSIDE = 1e-3  # rad or m
_TURNS, _NARROW = 4 * math.pi + 0.1, 2 * math.pi + 0.1  # rad; degrees, of all hinges of a model
_FEW = 3  # hinges
_LARGE, _TIMES = 10.0, 100.0  # m; times the longest distance of two joints


def axes(reading: Reading) -> Iterator[Defect]:
    """Axes whose length is not 1; to normalise them is certain, for it keeps their direction."""
    raw = {joint.attributes.get("name", ""): joint.first("axis") for joint in reading.raw.all("joint")}
    for joint in reading.moving:
        length = math.hypot(*(joint.axis or (1.0,)))
        if abs(length - 1) > _ROUNDING and joint.axis is not None:
            axis = " ".join(f"{x / length:.12g}" for x in joint.axis)
            element = raw.get(joint.name)
            written = "$" if element is None else element.attributes["xyz"]
            fix = None if "$" in written else Fix("axis", "xyz", written, axis)  # no number for what a xacro computes
            yield defect("axis-not-unit", joint.name, reading.line(element, joint.name),
                         f"an axis of length {length:.6g}", f'give "{axis}"', fix=fix,
                         severity="note" if abs(length - 1) < UNIT_TOLERANCE else None)  # fmt: skip


def limits(reading: Reading) -> Iterator[Defect]:
    """Limits of effort, velocity and position, and negative damping."""
    for joint in reading.moving:
        element = joint.element.first("limit")
        line = reading.line(element or joint.element, joint.name)
        if element is not None:
            yield from _rates(joint, element, line)
            if joint.type == "continuous" and {"lower", "upper"} & element.attributes.keys():
                yield defect("continuous-limits", joint.name, line, "lower or upper of a continuous joint",
                             'type="revolute" where it has stops, else leave them out')  # fmt: skip
        if joint.limits is not None:
            lower, upper = joint.limits
            if lower == upper:
                yield defect("unreachable-limits", joint.name, line, f"lower and upper are both {lower:g}",
                             'give both, or type="fixed"')  # fmt: skip
            elif lower > _OUTSIDE or upper < -_OUTSIDE:
                yield defect("unreachable-limits", joint.name, line, f"0 is outside ({lower:g}, {upper:g})",
                             "start within them", severity="note")  # fmt: skip
        for what, value in (("damping", joint.damping), ("friction", joint.friction)):
            if value < 0:
                yield defect("negative-damping", joint.name, reading.line(joint.element.first("dynamics"), joint.name),
                             f"{what} {value:g}", f"likely the sign: {-value:g}")  # fmt: skip


def _rates(joint: UrdfJoint, element: Element, line: int) -> Iterator[Defect]:
    """Limits of effort and velocity that are 0, or that no motor has."""
    for key, most, words in (("effort", _STRONG, "N m or N"), ("velocity", _FAST, "rad/s or m/s")):
        value = float(element.attributes.get(key, "1"))
        if value == 0:
            yield defect(f"{key}-limit", joint.name, line, f"{key} 0", "likely left out: give the motor's")
        elif most <= value < _NONE and not math.log10(value).is_integer():
            turns = key == "velocity" and joint.type != "prismatic" and math.radians(value) < most
            cause = f"likely degrees a second: give {math.radians(value):.4g} rad/s" if turns else "leave out no limit"
            yield defect(f"{key}-limit", joint.name, line, f"{key} {value:g} {words}", cause, severity="note")


def mimics(reading: Reading) -> Iterator[Defect]:
    """Mimic joints that cannot follow."""
    joints = {joint.name: joint for joint in reading.joints}
    for joint in reading.moving:
        if joint.mimic is None:
            continue
        line = reading.line(joint.element.first("mimic"), joint.name)
        what, remedy = mimic_fault(joint, joint.mimic, joints)
        if what:
            circle = "in a circle" in what
            yield defect("mimic-loop" if circle else "mimic-target", joint.name, line, what, remedy,
                         severity="note" if "mimics a joint that mimics" in what else None)  # fmt: skip
            continue
        leader = joints[joint.mimic.joint]
        if joint.limits is None or leader.limits is None:
            continue
        ends = sorted(joint.mimic.multiplier * end + joint.mimic.offset for end in leader.limits)
        apart = max(joint.limits[0] - ends[0], ends[1] - joint.limits[1])
        if apart > max(_OUTSIDE, 0.02 * (ends[1] - ends[0])):
            limits = "({:.4g}, {:.4g})".format(*joint.limits)
            yield defect("mimic-range", joint.name, line,
                         f"it is to reach ({ends[0]:.4g}, {ends[1]:.4g}), its limits are {limits}",
                         "check multiplier, offset and limits")  # fmt: skip


def mirrored_joints(reading: Reading) -> Iterator[Defect]:
    """Joints with another range, effort or velocity than their counterpart on the other side."""
    joints = {joint.name: joint for joint in reading.moving}
    for name, joint in joints.items():
        other = joints.get(other_side(name))
        if other is None or joint.limits is None or other.limits is None:
            continue
        ours, theirs = (np.array([each.limits[1] - each.limits[0], *_motor(each)]) for each in (joint, other))  # type: ignore[index]
        apart = np.abs(ours - theirs) / np.maximum(np.maximum(np.abs(ours), np.abs(theirs)), 1e-9)
        for what, size, a, b in zip(("range", "effort", "velocity"), apart, ours, theirs, strict=True):
            if size > 1e-2:
                yield defect("mirrored-pair", name, reading.line(joint.element.first("limit"), name),
                             f"beside {other.name!r}: {what} {a:.4g} and {b:.4g}",
                             severity=None if size > 0.05 else "note")  # fmt: skip


def _motor(joint: UrdfJoint) -> list[float]:
    element = joint.element.first("limit")
    return [float(element.attributes.get(key, "0")) if element else 0.0 for key in ("effort", "velocity")]


def shapes(reading: Reading) -> Iterator[Defect]:
    """Meshes without a file, out of proportion, or with an odd scale."""
    yield from _missing(reading)
    reach = max((math.hypot(*placement(joint.element).translation) for joint in reading.joints), default=0.0)
    for link in reading.links.values():
        for mesh in meshes(link.element):
            written = " ".join(mesh.attributes.get("scale", "1 1 1").split())
            scale = floats(written)
            if len(scale) != 3 or not all(0 < factor < math.inf for factor in scale):
                mirrored = len(scale) == 3 and all(0 < abs(factor) < math.inf for factor in scale)
                yield defect("mesh-scale", link.name, reading.line(mesh, link.name), f'scale="{written}"',
                             "a mirrored mesh, whose sides some programs turn inside out" if mirrored else
                             "give three positive numbers", severity="note" if mirrored else None)  # fmt: skip
                break
        sizes = [reading.shapes.extent(link.element, (tag,)).half_diagonal for tag in ("visual", "collision")]
        line = reading.line(link.element, link.name)
        meshed = next(meshes(link.element), None) is not None
        if meshed and max(sizes) > _LARGE and max(sizes) > _TIMES * reach > 0:
            what = f"shapes over {max(sizes):.4g} m, the joints are within {reach:.3g} m"
            yield defect("mesh-scale", link.name, line, what, 'likely in millimetres: scale="0.001 0.001 0.001"')
        elif min(sizes) > 0 and max(sizes) > _TIMES * min(sizes):
            what = f"the visual spreads over {sizes[0]:.3g} m, the collision over {sizes[1]:.3g} m"
            yield defect("mesh-scale", link.name, line, what, "likely one of them in another unit: give scale")


def _missing(reading: Reading) -> Iterator[Defect]:
    """Meshes without a file: those whose name has backslashes, which can be mended, and the others together."""
    robot = Element("robot", {}, 0, [link.element for link in reading.links.values()])
    missing = {name for names in missing_meshes(robot, reading.shapes.folders).values() for name in names}
    if reading.raw.tag == "mujoco":
        yield from (lost_mesh(reading.raw, name, "warning") for name in sorted(missing))
        return
    found = [mesh for link in robot.children for mesh in meshes(link) if mesh.attributes.get("filename", "") in missing]
    for mesh in found:
        if "\\" in (name := mesh.attributes.get("filename", "")):
            yield defect("mesh-missing", "", mesh.line, f"mesh {name!r}", "write / between folders",
                         fix=Fix("mesh", "filename", name, name.replace("\\", "/")))  # fmt: skip
            missing.discard(name)
    others = [mesh for mesh in found if mesh.attributes.get("filename", "") in missing]
    if others:
        first = others[0].attributes.get("filename", "")
        what = f"{len(missing)} meshes are not found, the first is" if len(missing) > 1 else "there is no mesh"
        yield defect("mesh-missing", "", others[0].line, f"{what} {first!r}",
                     "give --package-dir, or correct the names")  # fmt: skip


def ranges(reading: Reading) -> Iterator[Defect]:
    """Ranges of hinges in the other unit than <compiler angle> says."""
    if reading.raw.tag != "mujoco":
        return
    compilers = [one.attributes.get("angle", "") for one in reading.raw.all("compiler")]
    if any(part.tag == "include" for part in reading.raw.inside()) or "" in compilers:
        return  # what is included may say it
    radians = "radian" in compilers
    hinges = [part for part in reading.raw.inside()
              if part.tag == "joint" and part.attributes.get("type", "hinge") == "hinge"]  # fmt: skip
    found = [(joint, max(map(abs, ends))) for joint in hinges if any(ends := floats(joint.attributes.get("range", "")))]
    narrow = not radians and len(found) >= _FEW and max(width for _, width in found) < _NARROW
    for joint, width in found:
        if narrow or (radians and width > _TURNS):
            meant = "radians" if narrow else "degrees"
            yield defect("range-unit", joint.attributes.get("name", ""), joint.line,
                         f'range="{joint.attributes["range"]}" in {"radians" if radians else "degrees"}',
                         f'likely in {meant}: <compiler angle="{meant[:-1]}"/>')  # fmt: skip
