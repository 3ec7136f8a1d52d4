"""A scene with other physical constants and other numbers in its effects, by the names of run-time parameters."""

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from twolink.algorithms.mechanism import body_names
from twolink.algorithms.spatial import ENTRIES
from twolink.effects.effect import Effect
from twolink.integrate.effect_numbers import PREFIX, physical, with_number
from twolink.scenes import Scene

_COORDINATES = ("x", "y", "z")
_DAMPING = ".damping"


class _Constants(Effect, frozen=True):
    """Physical constants of a robot by name (`algorithms.mechanism.parameter_names`), set after all other effects."""

    values: Mapping[str, float]

    def change(self, model: pin.Model) -> None:
        """Set them."""
        values, links = self.values, body_names(model)
        model.gravity.linear = self._vector("gravity", model.gravity.linear)
        for i in range(1, model.njoints):
            body, link, joint = model.inertias[i], links[i], model.names[i]
            inertia = np.array(body.inertia)
            for j, k in ENTRIES:
                name = f"{link}.inertia.{_COORDINATES[j]}{_COORDINATES[k]}"
                inertia[j, k] = inertia[k, j] = values.get(name, inertia[j, k])
            lever = self._vector(f"{link}.com", body.lever)
            model.inertias[i] = pin.Inertia(float(values.get(f"{link}.mass", body.mass)), lever, inertia)
            placement = model.jointPlacements[i]
            placement.translation = self._vector(f"{joint}.origin", placement.translation)
            if model.joints[i].nv == 1:
                k = model.joints[i].idx_v
                model.armature[k] = values.get(f"{joint}.armature", model.armature[k])

    def _vector(self, name: str, own: np.ndarray) -> np.ndarray:
        return np.array([self.values.get(f"{name}.{axis}", x) for axis, x in zip(_COORDINATES, own, strict=True)])


def world_scene(scene: Scene, values: Mapping[str, float]) -> Scene:
    """The scene with these values of parameters, by name. A joint's damping acts, as run-time parameters do."""
    effects = list(scene.effects)
    for name in (name for name in values if name.startswith(PREFIX)):
        place, *path = name.removeprefix(PREFIX).split(".")
        effects[int(place)] = with_number(effects[int(place)], path, values[name])
    constants = physical(values)
    damping = {name.removesuffix(_DAMPING): d for name, d in constants.items() if name.endswith(_DAMPING)}
    if damping:
        from twolink.effects import JointDamping  # only where it is asked for

        effects.append(JointDamping(damping=damping))
    if constants:
        effects.append(_Constants(values=constants))
    return scene.with_effects(effects)
