"""A compiled MJCF: names, flags and arrays of mujoco.MjModel."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.errors import RobotError, import_extra
from twolink.robots.catalogue import Source

SHAPES = {2: "sphere", 3: "capsule", 5: "cylinder", 6: "box", 7: "mesh"}  # of mjtGeom


def compiled_mjcf(source: Source) -> Any:
    """The mujoco.MjModel of an MJCF. Raises RobotError (code "mjcf") in MuJoCo's words."""
    mujoco = import_extra("mujoco", "mjcf")
    try:
        if source.path is not None:
            return mujoco.MjModel.from_xml_path(str(source.path))
        return mujoco.MjModel.from_xml_string(source.data.decode())
    except ValueError as error:
        raise RobotError(f"MuJoCo refuses it: {' '.join(str(error).split())}", where=source.label, code="mjcf",
                         remedy="correct what it names; what others include is not a model") from None  # fmt: skip


@dataclass(frozen=True)
class Mjcf:
    """A compiled model, and names for its bodies and joints, which MJCF may leave out."""

    model: Any

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
        m, place, body = (
            self.model,
            pose(self.model.geom_pos[geom], self.model.geom_quat[geom]),
            int(self.model.geom_bodyid[geom]),
        )
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
