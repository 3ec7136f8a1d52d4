"""A scene with other physical constants and other numbers in its effects, by the names of run-time parameters."""

from collections.abc import Mapping

from twolink.integrate.effect_numbers import PREFIX, physical, with_effect_number
from twolink.scenes import Scene

_DAMPING = ".damping"


def world_scene(scene: Scene, values: Mapping[str, float]) -> Scene:
    """The scene with these values of parameters, by name. A joint's damping acts, as run-time parameters do."""
    from twolink.effects import Constants, JointDamping  # only where they are asked for

    effects = list(scene.effects)
    for name in (name for name in values if name.startswith(PREFIX)):
        effects = with_effect_number(effects, name, values[name])
    constants = physical(values)
    damping = {name.removesuffix(_DAMPING): d for name, d in constants.items() if name.endswith(_DAMPING)}
    if damping:
        effects.append(JointDamping(damping=damping))
    others = {name: value for name, value in constants.items() if not name.endswith(_DAMPING)}
    if others:
        effects.append(Constants(values=others))
    return scene.with_effects(effects)
