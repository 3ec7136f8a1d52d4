"""Fingerprints of a pin.Model: to nine digits for saved files, and bit for bit for compiled kernels."""

import functools
import hashlib
import platform
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pinocchio as pin

from twolink.io.model_trees import trees_of

KERNEL_FORMAT = 1
TRACED_ROOMS = (
    "algorithms",
    "contact",
    "dynamics",
    "effects",
    "integrate",
)  # whose code is in kernels


def model_digest(model: pin.Model) -> str:
    """A digest of what moves, for files that name a robot; gravity does not count.

    Numbers count to nine digits of the largest entry of their array, so that another build of the URDF parser gives
    the same digest.

    Parameters
    ----------
    model : pin.Model
        Joints count by name, type, axis and placement, bodies by their inertia.

    Returns
    -------
    str
        32 hexadecimal digits.
    """
    digest = hashlib.sha256(_structure(model).encode())
    for values in _constants(model):
        largest = float(np.abs(values).max(initial=0.0))
        scaled = np.round(values / largest, 9) + 0.0 if largest > 0 else np.zeros_like(values)  # + 0.0: no -0.0
        digest.update(f"{largest:.9g}".encode())
        digest.update(np.ascontiguousarray(scaled, dtype="<f8").tobytes())
    return digest.hexdigest()[:32]


def kernel_key(model: pin.Model, parts: Sequence[str]) -> str:
    """A name for what a compiled kernel is made from: every bit of the model, our code, versions and the processor.

    Parameters
    ----------
    model : pin.Model
        The model, gravity, damping, mimic joints and frames included.
    parts : sequence of str
        What else the kernel depends on, such as the name of its function.

    Returns
    -------
    str
        40 hexadecimal digits.
    """
    digest = hashlib.sha256(repr((_environment(), tuple(parts), _structure(model))).encode())
    for values in (*_constants(model), model.damping, model.gravity.linear):
        digest.update(np.ascontiguousarray(values).tobytes())
    mimics = [joint.extract() for joint in model.joints if "Mimic" in joint.shortname()]
    digest.update(repr([(repr(joint), joint.scaling, joint.offset) for joint in mimics]).encode())
    digest.update(repr([(f.name, f.parentJoint, f.placement.homogeneous.tolist()) for f in model.frames]).encode())
    return digest.hexdigest()[:40]


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
def _environment() -> str:
    """Our own code, the versions of the libraries it stands on, and the processor."""
    code = hashlib.sha256()
    package = Path(__file__).parents[1]
    for path in sorted(path for room in TRACED_ROOMS for path in (package / room).rglob("*.py")):
        code.update(path.read_bytes())
    versions = [f"{name} {version(name)}" for name in ("heyoka", "pin", "numpy")]
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))})
    except OSError:
        processor = [platform.processor()]
    return repr((KERNEL_FORMAT, code.hexdigest(), versions, sys.version, platform.machine(), processor))
