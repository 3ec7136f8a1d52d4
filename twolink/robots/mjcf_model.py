"""A compiled MJCF: names, flags and arrays of mujoco.MjModel."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import PurePath
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError, import_extra
from twolink.robots.catalogue import Source

SHAPES = {2: "sphere", 3: "capsule", 5: "cylinder", 6: "box", 7: "mesh"}  # of mjtGeom


def compiled_mjcf(source: Source) -> "Mjcf":
    """The compiled model of an MJCF. Raises RobotError (code "mjcf") in MuJoCo's words.

    Reading the meshes of a robot takes MuJoCo seconds. It reads a tetrahedron in place of those that give no body its
    mass and no shape its size, so that they may also be missing, as those of a URDF.
    """
    specs = import_extra("mujoco", "mjcf").MjSpec
    try:
        spec = specs.from_string(source.data.decode()) if source.path is None else specs.from_file(str(source.path))
        spec.assets = {**spec.assets, **_stand_ins(spec)}
        model = spec.compile()
    except ValueError as error:
        raise RobotError(f"MuJoCo refuses it: {' '.join(str(error).split())}", where=source.label, code="mjcf",
                         remedy="correct what it names; what others include is not a model") from None  # fmt: skip
    return Mjcf(model, {mesh.id: pose(mesh.refpos, mesh.refquat) for mesh in spec.meshes})


def _stand_ins(spec: Any) -> dict[str, bytes]:
    """A tetrahedron by the names of the files of meshes that nothing is computed from.

    MuJoCo tells the contents of two files of one name in two folders not apart.
    """
    needed = {geom.meshname for geom in spec.geoms if geom.meshname and _computes(geom)}
    found, kept = dict[str, bytes](), set[str]()
    for mesh in spec.meshes:
        file = PurePath(mesh.file)
        content = _tetrahedra().get(file.suffix.lower())
        # A mesh without a name has that of its file, behind the prefix of a model that is attached.
        if mesh.name in needed or any(name.endswith(file.stem) for name in needed):
            kept.add(file.name)
        elif content is not None:
            found[file.name if spec.strippath else os.path.join(spec.meshdir, mesh.file)] = content
    return {file: content for file, content in found.items() if PurePath(file).name not in kept}


def _computes(geom: Any) -> bool:
    """True if MuJoCo computes a size, or the mass of a body, from the mesh of a geom. World's bodies have no mass."""
    mujoco, body = import_extra("mujoco", "mjcf"), geom.parent
    always = geom.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE  # of its own file
    return geom.type != mujoco.mjtGeom.mjGEOM_MESH or bool(body.id and (always or not body.explicitinertial))


@cache
def _tetrahedra() -> dict[str, bytes]:
    """A tetrahedron as the content of mesh files, by their endings."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    triangles = np.zeros(len(faces), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]))
    triangles["corners"] = corners[faces]
    lines = [*(f"v {x} {y} {z}" for x, y, z in corners), *(f"f {i} {j} {k}" for i, j, k in faces + 1)]
    stl = bytes(80) + len(faces).to_bytes(4, "little") + triangles.tobytes()
    return {".stl": stl, ".obj": "\n".join(lines).encode()}


@dataclass(frozen=True)
class Mjcf:
    """A compiled model, and names for its bodies and joints, which MJCF may leave out.

    references: refpos and refquat of meshes, by number, which a compiled model does not hold.
    """

    model: Any
    references: Mapping[int, pin.SE3] = field(default_factory=dict)

    def mesh_placement(self, mesh: int) -> pin.SE3 | None:
        """The pose of a mesh file, scaled, in the axes of the compiled mesh; None where no pose takes it there.

        MuJoCo's vertices are S R^T (x - t), of those x of the file, the scale S, and the reference t, R; and then along
        the principal axes.
        """
        m, reference = self.model, self.references.get(mesh, pin.SE3.Identity())
        scale, turn = np.asarray(m.mesh_scale[mesh], dtype=float), reference.rotation
        if not np.allclose(turn * scale, scale[:, None] * turn, rtol=0.0, atol=1e-6 * np.abs(scale).max()):
            return None
        moved = pin.SE3(turn, scale * reference.translation)
        return pose(m.mesh_pos[mesh], m.mesh_quat[mesh]).inverse() * moved.inverse()

    def names(self, kind: str, shown: str = "") -> list[str]:
        """The names of all elements of a kind, such as "sensor", in MuJoCo's order; a number where there is none.

        shown: what stands before each in messages, as in sensor 'x'.
        """
        starts = getattr(self.model, f"name_{kind}adr", ())
        named = [self.model.names[start:].split(b"\0")[0].decode() or f"{kind}{k}" for k, start in enumerate(starts)]
        return [f"{shown} {name!r}" for name in named] if shown else named

    @cached_property
    def bodies(self) -> list[str]:
        """One name a body."""
        return _unique(self.names("body"))

    @cached_property
    def joints(self) -> list[str]:
        """One name a joint."""
        owners = [self.bodies[body] for body in self.model.jnt_bodyid]
        named = zip(self.names("jnt"), owners, self.model.name_jntadr, strict=True)
        return _unique([name if self.model.names[start] else f"{owner}_joint" for name, owner, start in named])

    def joints_of(self, body: int) -> range:
        """The joints of a body, the outermost first."""
        first = int(self.model.body_jntadr[body])
        return range(first, first + int(self.model.body_jntnum[body]))

    def placed(self, geom: int) -> pin.SE3:
        """The pose of a geom whose body is fixed to the world."""
        m, body = self.model, int(self.model.geom_bodyid[geom])
        place = pose(m.geom_pos[geom], m.geom_quat[geom])
        while body:
            place, body = pose(m.body_pos[body], m.body_quat[body]) * place, int(m.body_parentid[body])
        return place

    def is_off(self, *flags: str) -> bool:
        """True if a flag such as "SPRING" disables a part of the model."""
        bits = import_extra("mujoco", "mjcf").mjtDisableBit
        return any(int(self.model.opt.disableflags) & int(getattr(bits, f"mjDSBL_{flag}", 0)) for flag in flags)

    def numbers(self, name: str, count: int) -> np.ndarray:
        """An array of the model with `count` rows; zeros where this version of MuJoCo has none."""
        values = np.asarray(getattr(self.model, name, np.zeros(count)))
        return values.reshape(count, -1) if values.size else np.zeros((count, 1))

    def actuators_of(self, joint: int) -> list[int]:
        """The actuators that act on a joint directly."""
        m = self.model
        return [k for k, kind in enumerate(m.actuator_trntype) if kind in (0, 1) and m.actuator_trnid[k, 0] == joint]

    def added_by_actuators(self, what: str, joint: int) -> float:
        """The armature or damping that the actuators of a joint add to it."""
        values, gear = self.numbers(f"actuator_{what}", len(self.model.actuator_trntype)), self.model.actuator_gear
        return float(sum(values[k, 0] * gear[k, 0] ** 2 for k in self.actuators_of(joint)))


def _unique(names: list[str]) -> list[str]:
    """The names; those that stand a second time with a number."""
    taken: list[str] = []
    for name in names:
        numbered = (f"{name}{k}" for k in range(2, len(names) + 2))
        taken.append(name if name not in taken else next(n for n in numbered if n not in names and n not in taken))
    return taken


def pose(position: np.ndarray, quaternion: np.ndarray) -> pin.SE3:
    """A pose from MuJoCo's position and quaternion (w, x, y, z)."""
    return pin.SE3(pin.Quaternion(*map(float, quaternion)).normalized().matrix(), np.array(position, dtype=float))
