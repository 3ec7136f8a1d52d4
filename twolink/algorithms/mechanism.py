"""Mechanism: the constants of a pin.Model, as Python floats, any of which may be replaced by a run-time parameter.

Bodies are numbered as in Pinocchio and in Featherstone 2008, chapter 4: body 0 is the world, parents[i] < i.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from twolink.algorithms import spatial as sp
from twolink.algorithms.joint_models import JointKinematics, read_joint
from twolink.algorithms.spatial import ZERO, Inertia, Pose, Scalar, Vec
from twolink.errors import QueryError, require_known


@dataclass(frozen=True)
class Mechanism:
    """The constants that the recursions read. Lists over bodies start with the world, whose joint is a placeholder.

    placements: the pose of each joint's fixed frame in its parent's frame.
    inertias: the ten parameters of each body, about its joint's frame.
    armature, damping (nv): kg m^2 and N m s; a damping torque -d v acts only where damping was asked for.
    """

    nq: int
    nv: int
    parents: tuple[int, ...]
    joints: tuple[JointKinematics, ...]
    placements: tuple[Pose, ...]
    inertias: tuple[Inertia, ...]
    armature: tuple[Scalar, ...]
    damping: tuple[Scalar, ...]
    gravity: Vec

    @property
    def bodies(self) -> range:
        """The moving bodies, parents first."""
        return range(1, len(self.parents))

    @property
    def has_mimic(self) -> bool:
        """True if some joints follow others."""
        return any(joint.mimic for joint in self.joints)

    def support(self, body: int) -> list[int]:
        """The bodies from `body` to the root, both included: kappa(i) in Featherstone's chapter 4."""
        path = []
        while body:
            path.append(body)
            body = self.parents[body]
        return path

    def dof_parents(self) -> list[int]:
        """lambda over degrees of freedom, -1 at a root: Featherstone's expanded parent array, section 6.5.

        A mimic joint couples branches: the mass matrix of its robot is taken as dense, each dof the parent of the next.
        """
        if self.has_mimic:
            return [k - 1 for k in range(self.nv)]
        parents, last = [-1] * self.nv, [-1] * len(self.parents)
        for i in self.bodies:
            last[i] = last[self.parents[i]]
            for k in self.joints[i].dofs:
                parents[k], last[i] = last[i], k
        return parents


# The ten parameters of a body in which its forces are linear, about the origin of the joint that carries it.
BODY_PARAMETERS = (
    "mass", "first_moment.x", "first_moment.y", "first_moment.z", "origin_inertia.xx", "origin_inertia.xy",
    "origin_inertia.yy", "origin_inertia.xz", "origin_inertia.yz", "origin_inertia.zz",
)  # fmt: skip
_WORLD = JointKinematics("revolute", ZERO, (), ())
_COORDINATES = ("x", "y", "z")
_MOMENTS = tuple(_COORDINATES[i] + _COORDINATES[j] for i, j in sp.ENTRIES)


def mechanism(model: pin.Model, parameters: Mapping[str, Scalar] | None = None) -> Mechanism:
    """The model's constants with regrouped inertias: the same motion and energies with fewer operations.

    Each body passes on to its parent the part of its inertia that does not feel the joint between them
    (`JointKinematics.passed_on`). The inertias are then no longer those of the single bodies.

    parameters: constants to replace by scalars, arrays or symbols, by name (`parameter_names`). Raises QueryError for
    an unknown name.
    """
    return _regrouped(single_bodies(model, parameters))


def single_bodies(model: pin.Model, parameters: Mapping[str, Scalar] | None = None) -> Mechanism:
    """The model's constants with the inertias of the single bodies; parameters as in `mechanism`."""
    chosen = dict(parameters or {})
    values = nominal_values(model)
    for name, value in chosen.items():
        _require_parameter(name, values)
        values[name] = float(value) if isinstance(value, (int, float, np.floating)) else value
    bodies, joints = body_names(model), range(1, model.njoints)
    return Mechanism(
        nq=model.nq,
        nv=model.nv,
        parents=tuple(model.parents.tolist()),
        gravity=(values["gravity.x"], values["gravity.y"], values["gravity.z"]),
        joints=(_WORLD, *(read_joint(model, i) for i in joints)),
        placements=(sp.AT_PARENT, *(_placement(model, i, values) for i in joints)),
        inertias=(sp.NO_INERTIA, *(_inertia(bodies[i], values) for i in joints)),
        armature=_per_dof(model, "armature", values, model.armature.tolist()),
        damping=_per_dof(model, "damping", {name: values[name] for name in chosen}, [0.0] * model.nv),
    )


def parameter_names(model: pin.Model) -> tuple[str, ...]:
    """The physical constants that can be kept as run-time parameters.

    gravity.x|y|z. Of a link that moves: LINK.mass, LINK.com.x|y|z and LINK.inertia.xx|xy|xz|yy|yz|zz (about the
    centre of mass), along the axes of the joint that carries it; links fixed to it are part of it, and it has the
    name of the first. Of a joint: JOINT.origin.x|y|z, where it sits in its parent's joint frame; and with one
    degree of freedom, JOINT.armature and JOINT.damping.
    """
    return tuple(nominal_values(model))


def nominal(model: pin.Model, name: str) -> float:
    """The model's own value of a parameter, or of a moment of a link, SI units. Raises QueryError for other names."""
    values = nominal_values(model)
    if name not in values:
        values |= moments(model)
    _require_parameter(name, values)
    return values[name]


def _require_parameter(name: str, values: Mapping[str, Scalar]) -> None:
    require_known(name, values, QueryError, "there is no parameter {!r}", argument="parameters",
                  code="unknown-parameter")  # fmt: skip


def with_nominal(model: pin.Model, name: str, value: float) -> None:
    """Give a model, which is changed, another value of a parameter, or of a moment of a link."""
    owner, part, entry = split_name(name)
    bodies = {link: i for i, link in enumerate(body_names(model))}
    if part == "gravity":
        field = model.gravity.linear.copy()
        field[_COORDINATES.index(entry)] = value
        model.gravity.linear = field
        return
    if part in ("mass", "com", "inertia"):
        body = model.inertias[bodies[owner]].copy()
        lever, rotational = body.lever.copy(), body.inertia.copy()
        if part == "mass":
            body.mass = value
        elif part == "com":
            lever[_COORDINATES.index(entry)] = value
            body.lever = lever
        else:
            j, k = sp.ENTRIES[_MOMENTS.index(entry)]
            rotational[j, k] = rotational[k, j] = value
            body.inertia = rotational
        model.inertias[bodies[owner]] = body
        return
    if f"{part}.{entry}" in BODY_PARAMETERS:
        body = model.inertias[bodies[owner]].toDynamicParameters()
        body[BODY_PARAMETERS.index(f"{part}.{entry}")] = value
        model.inertias[bodies[owner]] = pin.Inertia.FromDynamicParameters(body)
        return
    joint = model.getJointId(owner)
    if part == "origin":
        model.jointPlacements[joint].translation[_COORDINATES.index(entry)] = value
    else:
        values = model.armature if part == "armature" else model.damping
        values[model.joints[joint].idx_v] = value


def split_name(name: str) -> tuple[str, str, str]:
    """(owner, part, entry) of a parameter, such as ("forearm", "com", "x"); the owner's name may have dots.

    Gravity is a part that nothing owns; what has one entry has an empty name for it.
    """
    owner, _, last = name.rpartition(".")
    if last in ("mass", "armature", "damping"):
        return owner, last, ""
    owner, _, part = owner.rpartition(".")
    return owner, part, last


def nominal_values(model: pin.Model) -> dict[str, float]:
    """The model's own values of all parameters, SI units, by name."""
    names = body_names(model)
    values = dict(zip(("gravity.x", "gravity.y", "gravity.z"), model.gravity.linear.tolist(), strict=True))
    for i in range(1, model.njoints):
        body, name = model.inertias[i], model.names[i]
        rotational = body.inertia
        values[f"{names[i]}.mass"] = float(body.mass)
        for axis, value in zip(_COORDINATES, body.lever.tolist(), strict=True):
            values[f"{names[i]}.com.{axis}"] = value
        for moment, (j, k) in zip(_MOMENTS, sp.ENTRIES, strict=True):
            values[f"{names[i]}.inertia.{moment}"] = float(rotational[j, k])
        for axis, value in zip(_COORDINATES, model.jointPlacements[i].translation.tolist(), strict=True):
            values[f"{name}.origin.{axis}"] = value
        if model.joints[i].nv == 1:
            values[f"{name}.armature"] = float(model.armature[model.joints[i].idx_v])
            values[f"{name}.damping"] = float(model.damping[model.joints[i].idx_v])
    return values


def moments(model: pin.Model) -> dict[str, float]:
    """First moments [kg m] and inertias [kg m^2] of the links about the joints that carry them, by name."""
    bodies = zip(body_names(model)[1:], list(model.inertias)[1:], strict=True)
    return {f"{link}.{part}": float(value) for link, body in bodies
            for part, value in zip(BODY_PARAMETERS[1:], body.toDynamicParameters()[1:], strict=True)}  # fmt: skip


def body_names(model: pin.Model) -> list[str]:
    """The link each joint carries: the first BODY frame on it; the joint's own name where there is none."""
    names: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            names.setdefault(frame.parentJoint, frame.name)
    return [names.get(i, model.names[i]) for i in range(model.njoints)]


def _placement(model: pin.Model, index: int, values: Mapping[str, Scalar]) -> Pose:
    x, y, z = ((_exact(a), _exact(b), _exact(c)) for a, b, c in model.jointPlacements[index].rotation.tolist())
    origin = tuple(values[f"{model.names[index]}.origin.{axis}"] for axis in _COORDINATES)
    return Pose(((x, y, z),), (origin[0], origin[1], origin[2]))


def _exact(entry: float) -> float:
    """A rotation's entry; 0 or 1 where the rounding of a right angle moved it by a unit in the last place."""
    nearest_whole = round(entry)
    return float(nearest_whole) if abs(entry - nearest_whole) < 1e-15 else entry


def _inertia(link: str, values: Mapping[str, Scalar]) -> Inertia:
    mass = values[f"{link}.mass"]
    x, y, z = (values[f"{link}.com.{axis}"] for axis in _COORDINATES)
    xx, xy, xz, yy, yz, zz = (values[f"{link}.inertia.{moment}"] for moment in _MOMENTS)
    return Inertia(mass, sp.scale(mass, (x, y, z)), sp.second_moment(mass, (x, y, z), (xx, xy, xz, yy, yz, zz)))


def _per_dof(model: pin.Model, what: str, values: Mapping[str, Scalar], default: list[Scalar]) -> tuple[Scalar, ...]:
    for i in range(1, model.njoints):
        if model.joints[i].nv == 1:
            k = model.joints[i].idx_v
            default[k] = values.get(f"{model.names[i]}.{what}", default[k])
    return tuple(default)


def _regrouped(mech: Mechanism) -> Mechanism:
    """The mechanism with its inertias passed on towards the root, as far as they do not feel the joints."""
    inertias = list(mech.inertias)
    for i in reversed(mech.bodies):
        placement, parent = mech.placements[i], mech.parents[i]
        if not all(map(sp.constant, placement.origin)):
            continue  # a length that is a parameter: the inertia passed on would not be constant
        part = mech.joints[i].passed_on(inertias[i])
        left = sp.inertia_add(inertias[i], _minus(part))
        inertias[i] = left
        inertias[parent] = sp.inertia_add(inertias[parent], sp.inertia_to_parent(placement, part))
    return replace(mech, inertias=tuple(inertias))


def _minus(body: Inertia) -> Inertia:
    xx, xy, xz, yy, yz, zz = map(sp.negative, body.second)
    return Inertia(sp.negative(body.mass), sp.scale(-1.0, body.first), (xx, xy, xz, yy, yz, zz))
