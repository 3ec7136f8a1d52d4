"""Fingerprints: of a pin.Model, to nine digits for saved files, and bit for bit for compiled kernels; of our code. The
trees of a model: its parts that only the ground connects, each as a model of its own.

A pin.Data takes about nv^3 numbers. That of many bodies in one model fills any memory; those of the bodies do not.
"""

import functools
import hashlib
import platform
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

KERNEL_FORMAT = 1
PACKAGE = Path(__file__).parents[1]
LIBRARIES = ("pin", "numpy", "scipy", "example-robot-data")  # which results depend on
# Whose code is in kernels.
TRACED_ROOMS = ("algorithms", "contact", "dynamics", "effects", "geometry", "integrate", "native")
# What a URDF says of joints beside their inertias: effects may act by it.
OF_JOINTS = ("damping", "friction", "effortLimit", "velocityLimit", "lowerPositionLimit", "upperPositionLimit",
             "rotorInertia", "rotorGearRatio")  # fmt: skip


class ModelTree(NamedTuple):
    """A part of a model. q, v: its entries of the whole's. joints: the numbers of its joints there."""

    model: pin.Model
    q: slice
    v: slice
    joints: range


def trees_of(model: pin.Model) -> tuple[ModelTree, ...]:
    """The trees of a model, in the order of its joints; the model itself where it is one, or has mimic joints."""
    root = list(range(model.njoints))
    for j in range(1, model.njoints):
        root[j] = root[model.parents[j]] or j
    starts = sorted(set(root[1:]))
    if len(starts) < 2 or root != sorted(root) or len(model.mimicking_joints):
        return (ModelTree(model, slice(0, model.nq), slice(0, model.nv), range(1, model.njoints)),)
    ends = [*starts[1:], model.njoints]
    return tuple(_tree(model, range(start, end)) for start, end in zip(starts, ends, strict=True))


def _tree(model: pin.Model, joints: range) -> ModelTree:
    """The joints of a tree and their bodies as a model, without frames and limits."""
    out, first, last = pin.Model(), joints[0], joints[-1]
    for j in joints:
        parent = int(model.parents[j])
        k = out.addJoint(parent and parent - first + 1, model.joints[j], model.jointPlacements[j], model.names[j])
        out.appendBodyToJoint(k, model.inertias[j], pin.SE3.Identity())
    q = slice(model.idx_qs[first], model.idx_qs[last] + model.nqs[last])
    v = slice(model.idx_vs[first], model.idx_vs[last] + model.nvs[last])
    out.armature, out.gravity = model.armature[v], model.gravity
    return ModelTree(out, q, v, joints)


def joint_poses(model: pin.Model, q: np.ndarray) -> list[pin.SE3]:
    """Poses of the joints at a configuration (nq,), the ground first, without a pin.Data."""
    poses = [pin.SE3.Identity()]
    for j in range(1, model.njoints):
        data = model.joints[j].createData()
        model.joints[j].calc(data, q)
        poses.append(poses[model.parents[j]] * model.jointPlacements[j] * data.M)
    return poses


def model_digest(model: pin.Model, *, whole: bool = False) -> str:
    """A digest of what moves, for files that name a robot; gravity does not count.

    Numbers count to nine digits of the largest entry of their array, so that another build of the URDF parser gives
    the same digest.

    Parameters
    ----------
    model : pin.Model
        Joints count by name, type, axis and placement, bodies by their inertia.
    whole : bool
        Losses and limits of joints, mimic joints and frames count too: effects may act by them.

    Returns
    -------
    str
        32 hexadecimal digits.
    """
    digest = hashlib.sha256(_structure(model).encode())
    frames = [frame.placement.homogeneous for frame in model.frames] if whole else []
    for values in (*_constants(model), *frames):
        largest = float(np.abs(values).max(initial=0.0))
        scaled = np.round(values / largest, 9) + 0.0 if largest > 0 else np.zeros_like(values)  # + 0.0: no -0.0
        digest.update(f"{largest:.9g}".encode())
        digest.update(np.ascontiguousarray(scaled, dtype="<f8").tobytes())
    if whole:
        of_joints = [getattr(model, name).tolist() for name in OF_JOINTS]
        digest.update(repr((of_joints, _mimics(model), [(f.name, f.parentJoint) for f in model.frames])).encode())
    return digest.hexdigest()[:32]


def changed_joint(
    model: pin.Model, other: pin.Model, names: Mapping[str, str] | None = None, at: pin.SE3 | None = None,
    near: float = 1e-12,
) -> str:  # fmt: skip
    """The first joint whose body, placement, armature, losses or limits are others in another model; "" if none.

    names: those of joints there, where they are others; joints that the other model lacks do not count. at: the pose of
    this model's ground in that one. near: relative: numbers that are the same.
    """
    for j in range(1, model.njoints):
        name = str(model.names[j])
        k = other.getJointId((names or {}).get(name, name))
        if k == other.njoints:
            continue  # such as a base that is fixed there
        place = at * model.jointPlacements[j] if at is not None and not other.parents[k] else model.jointPlacements[j]
        ours, theirs = _of_joint(model, j), _of_joint(other, k)
        if (ours.shape != theirs.shape or not np.allclose(ours, theirs, rtol=near, atol=1e-3 * near)
                or not place.isApprox(other.jointPlacements[k], 1e-9)):  # fmt: skip
            return name
    return ""


def _of_joint(model: pin.Model, j: int) -> np.ndarray:
    """The numbers of a joint and its body, without the placement."""
    q, v = (slice(starts[j], starts[j] + sizes[j])
            for starts, sizes in ((model.idx_qs, model.nqs), (model.idx_vs, model.nvs)))  # fmt: skip
    is_free = model.joints[j].shortname() == "JointModelFreeFlyer"  # whose limits Pinocchio sets, in two ways
    of_joint = [getattr(model, name)[q if "Position" in name else v] for name in ("armature", *OF_JOINTS)
                if not (is_free and name.endswith("Limit"))]  # fmt: skip
    return np.concatenate([model.inertias[j].toDynamicParameters(), *of_joint])


def kernel_key(model: pin.Model, parts: Sequence[str]) -> str:
    """A name for what a compiled kernel is made from: every bit of the model, our code, versions and the processor.

    Parameters
    ----------
    model : pin.Model
        The model; gravity, friction and limits of joints, mimic joints and frames included.
    parts : sequence of str
        What else the kernel depends on, such as the name of its function.

    Returns
    -------
    str
        40 hexadecimal digits.
    """
    digest = hashlib.sha256(repr((_environment(), tuple(parts), _structure(model))).encode())
    for values in (*_constants(model), *(getattr(model, name) for name in OF_JOINTS), model.gravity.linear):
        digest.update(np.ascontiguousarray(values).tobytes())
    digest.update(repr(_mimics(model)).encode())
    digest.update(repr([(f.name, f.parentJoint, f.placement.homogeneous.tolist()) for f in model.frames]).encode())
    return digest.hexdigest()[:40]


def _mimics(model: pin.Model) -> list[tuple[str, float, float]]:
    """The mimic joints: what they follow, by which multiplier and offset."""
    mimics = [joint.extract() for joint in model.joints if "Mimic" in joint.shortname()]
    return [(repr(joint), joint.scaling, joint.offset) for joint in mimics]


def _structure(model: pin.Model) -> str:
    """The joints' types, names and parents."""
    joints = [joint.shortname() for joint in model.joints]
    return repr((joints, list(model.names), [int(parent) for parent in model.parents]))


def _constants(model: pin.Model) -> Iterator[np.ndarray]:
    """The constants of joints and bodies, array by array."""
    # Pinocchio does not show the axes of its joints; the Jacobians at the neutral configuration do.
    yield np.hstack([_neutral_jacobian(tree.model) for tree in trees_of(model)])
    yield np.asarray(model.armature)
    for placement, body in zip(model.jointPlacements, model.inertias, strict=True):
        yield from (placement.translation, placement.rotation, np.array([body.mass]), body.lever, body.inertia)


def _neutral_jacobian(model: pin.Model) -> np.ndarray:
    """6 rows, also where Pinocchio gives one column as (6,)."""
    return np.asarray(pin.computeJointJacobians(model, model.createData(), pin.neutral(model))).reshape(6, -1)


@functools.cache
def code_key(*rooms: str) -> str:
    """A digest of the package's code and data, all of it or that of some rooms, and the versions of its libraries.

    Parameters
    ----------
    *rooms : str
        Folders of the package; all of them by default.

    Returns
    -------
    str
        40 hexadecimal digits.
    """
    folders = [PACKAGE / room for room in rooms] or [PACKAGE]
    files = (path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".toml", ".csv"))
    found = [f"{name} {version}" for name, version in versions(LIBRARIES).items()]
    return hashlib.sha256(repr((files_digest(files), found, sys.version)).encode()).hexdigest()[:40]


def files_digest(paths: Iterable[Path]) -> str:
    """A digest of files: their names and what they hold."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def versions(libraries: Iterable[str]) -> dict[str, str]:
    """The versions of libraries by name, empty where one is not installed."""
    found = {}
    for library in libraries:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            found[library] = ""
    return found


def processor() -> str:
    """The kind of this machine's processor."""
    return next((line.partition(":")[2].strip() for line in _processor_lines() if line.startswith("model name")), "")


@functools.cache
def _processor_lines() -> tuple[str, ...]:
    """The lines Linux has of the processors; on other systems the kind alone, as Linux would say it."""
    try:
        return tuple(Path("/proc/cpuinfo").read_text("utf-8").splitlines())
    except OSError:
        return (f"model name: {platform.processor()}",)


@functools.cache
def _environment() -> str:
    """The code that kernels are made by, the libraries it stands on, and the processor."""
    said = sorted({line for line in _processor_lines() if line.startswith(("model name", "flags", "Features"))})
    return repr((KERNEL_FORMAT, code_key(*TRACED_ROOMS), platform.machine(), said))
