"""Effects: what a scene calls for. One file an effect, with its equation and source, imported when it is used.

In: joints, frames and numbers with units. Out: forces, controllers, constraints and, for effects that switch, their
own modes and guards, as formulas. This room knows no integration method and no scene.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from twolink.effects.effect import Effect
from twolink.io.text import kebab_case

if TYPE_CHECKING:
    from twolink.effects.air_drag import AirDrag
    from twolink.effects.computed_torque import ComputedTorque
    from twolink.effects.conditions import FrameReaches, JointReaches
    from twolink.effects.coupling import Coupling
    from twolink.effects.dry_friction import DryFriction
    from twolink.effects.frame_wrench import FrameWrench
    from twolink.effects.gravity import Gravity
    from twolink.effects.gravity_compensation import GravityCompensation
    from twolink.effects.hinge_loop import HingeLoop
    from twolink.effects.inputs import Polynomial, Sine
    from twolink.effects.joint_damping import JointDamping
    from twolink.effects.joint_pd import JointPD
    from twolink.effects.joint_spring import JointSpring
    from twolink.effects.joint_stops import JointStops
    from twolink.effects.payload import Payload
    from twolink.effects.plane_contact import PlaneContact
    from twolink.effects.point_loop import PointLoop
    from twolink.effects.release import Release
    from twolink.effects.rotor import Rotor
    from twolink.effects.sampled import Sampled
    from twolink.effects.smooth_friction import SmoothFriction
    from twolink.effects.spring_between import SpringBetween
    from twolink.effects.torque import Torque
    from twolink.effects.watch import Watch
    from twolink.effects.weld_loop import WeldLoop

# Where each effect lives: a scene without it does not even import its module.
EFFECTS = {
    "AirDrag": "air_drag",
    "ComputedTorque": "computed_torque",
    "FrameWrench": "frame_wrench",
    "Gravity": "gravity",
    "GravityCompensation": "gravity_compensation",
    "JointDamping": "joint_damping",
    "JointPD": "joint_pd",
    "JointSpring": "joint_spring",
    "Payload": "payload",
    "Rotor": "rotor",
    "SmoothFriction": "smooth_friction",
    "SpringBetween": "spring_between",
    "Torque": "torque",
    "PointLoop": "point_loop",
    "HingeLoop": "hinge_loop",
    "WeldLoop": "weld_loop",
    "Coupling": "coupling",
    "DryFriction": "dry_friction",
    "JointStops": "joint_stops",
    "PlaneContact": "plane_contact",
    "Release": "release",
    "Watch": "watch",
}
_OTHERS = {
    "FrameReaches": "conditions",
    "JointReaches": "conditions",
    "Polynomial": "inputs",
    "Sampled": "sampled",
    "Sine": "inputs",
}
TYPES = {kebab_case(name): name for name in EFFECTS}


def __getattr__(name: str) -> Any:
    module = EFFECTS.get(name) or _OTHERS.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"twolink.effects.{module}"), name)


def effect_class(type_: str) -> type[Effect]:
    """The class of an effect by its `type` in scene files. Raises KeyError."""
    found: type[Effect] = __getattr__(TYPES[type_])
    return found


__all__ = [
    "EFFECTS",
    "TYPES",
    "AirDrag",
    "ComputedTorque",
    "Coupling",
    "DryFriction",
    "Effect",
    "FrameReaches",
    "FrameWrench",
    "Gravity",
    "GravityCompensation",
    "HingeLoop",
    "JointDamping",
    "JointPD",
    "JointReaches",
    "JointSpring",
    "JointStops",
    "Payload",
    "PlaneContact",
    "PointLoop",
    "Polynomial",
    "Release",
    "Rotor",
    "Sampled",
    "Sine",
    "SmoothFriction",
    "SpringBetween",
    "Torque",
    "Watch",
    "WeldLoop",
    "effect_class",
]
