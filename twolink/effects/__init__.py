"""Effects: what a scene calls for, each a class with its equation and source, imported when it is used.

In: joints, frames and numbers with units. Out: forces, controllers, constraints and, for effects that switch, their
own modes and guards, as formulas. This room knows no integration method and no scene.

`__init__.pyi` lists what there is, one line a name: type checkers and editors read it, and so does this module.
"""

import importlib
import re
from pathlib import Path
from typing import Any

from twolink.errors import nearest
from twolink.io.text import kebab_case

_IMPORTS = re.findall(r"^from (\S+) import (\w+) as", Path(__file__).with_suffix(".pyi").read_text("utf-8"), re.M)
_MODULES = {name: module for module, name in _IMPORTS}
# TYPES: the effects' names by their `type` in scene files. The other names serve effects as arguments or as a base.
_OTHERS = {"Bezier", "Box", "Capsule", "Controller", "Convex", "Cylinder", "Effect", "FrameReaches", "HeightField",
           "JointReaches", "Observed", "Plane", "Policy", "Polynomial", "Sampled", "Sine", "Sphere",
           "Winding"}  # fmt: skip
TYPES = {kebab_case(n): n for n in _MODULES if n not in _OTHERS}
# What others call an effect, where no name here is near.
_USUAL = {"CoulombFriction": "DryFriction", "Friction": "DryFriction", "Stiction": "DryFriction",
          "Damper": "JointDamping", "ViscousFriction": "JointDamping", "Limits": "JointStops", "PD": "JointPD",
          "PDController": "JointPD", "Servo": "JointPD", "Force": "FrameWrench", "ExternalForce": "FrameWrench",
          "Mass": "Payload", "Ground": "Contact", "Floor": "Contact"}  # fmt: skip
USUAL_TYPES = {kebab_case(other): kebab_case(name) for other, name in _USUAL.items()}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        hint = "" if name.startswith("_") else f"; {nearest(name, _MODULES, _USUAL)}"
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return __all__


def effect_class(type_: str) -> Any:
    """The class of an effect by its `type` in scene files. Raises KeyError."""
    return __getattr__(TYPES[type_])
