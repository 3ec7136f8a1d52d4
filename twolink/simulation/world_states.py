"""The initial states and the parameters of many worlds, checked."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from twolink.algorithms.mechanism import parameter_names
from twolink.dynamics.arguments import array, configuration
from twolink.errors import SceneError, require_known
from twolink.integrate.assembly import assembled
from twolink.integrate.effect_numbers import PREFIX, all_effect_numbers
from twolink.integrate.equations import Equations
from twolink.scenes import Scene
from twolink.simulation.world_scenes import world_scene

NOT_NEGATIVE = (".mass", ".armature", ".damping", ".inertia.xx", ".inertia.yy", ".inertia.zz")


def world_states(scene: Scene, q: Any, v: Any, parameters: Any) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The initial states (nq + nv, n), and the values (n,) of each parameter by name. Raises SceneError."""
    robot = scene.robot
    names = (*parameter_names(robot.model), *all_effect_numbers(scene))
    if not (parameters is None or isinstance(parameters, Mapping)):
        raise SceneError(f"expected values by name, got {type(parameters).__name__}", argument="parameters",
                         remedy='such as {"forearm.mass": [1.0, 2.0]}')  # fmt: skip
    by_name = {str(name): value for name, value in (parameters or {}).items()}
    for name in by_name:
        require_known(name, names, SceneError, "there is no parameter {!r}", argument="parameters")
    qs = configuration("q", scene.q if q is None else q, robot.nq, robot.joints)
    vs = array("v", scene.v if v is None else v, robot.nv)
    values = {name: _values(name, value) for name, value in by_name.items()}
    _check_effects(scene, values)
    sizes = {"q": qs.shape[:-1], "v": vs.shape[:-1], **{name: a.shape for name, a in values.items()}}
    try:
        shape = np.broadcast_shapes(*sizes.values())
    except ValueError:
        raise SceneError(f"the worlds do not match: {sizes}", where="q, v, parameters",
                         remedy="give each one world, or the same number") from None  # fmt: skip
    if len(shape) > 1:
        raise SceneError(f"expected worlds (n,), got {shape}", argument="q", remedy="reshape to (n, nq)")
    count = shape[0] if shape else 1
    if count == 0:
        raise SceneError("there are no worlds", argument="q", remedy="give at least one")
    x = np.concatenate([np.broadcast_to(qs, (count, robot.nq)), np.broadcast_to(vs, (count, robot.nv))], axis=1)
    return np.ascontiguousarray(x.T), {name: np.broadcast_to(a, (count,)).copy() for name, a in values.items()}


def _check_effects(scene: Scene, values: Mapping[str, np.ndarray]) -> None:
    """Require that effects may have the smallest and the largest of the values of their numbers. Raises SceneError."""
    for name in (name for name in values if name.startswith(PREFIX)):
        for value in (values[name].min(), values[name].max()) if values[name].size else ():
            world_scene(scene, {name: float(value)})


def _values(name: str, value: Any) -> np.ndarray:
    """The values (...,) of a parameter: finite numbers that a body can have."""
    where = f"parameters[{name!r}]"
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"expected numbers, got {value!r:.60}", where=where, argument="parameters",
                         remedy="one, or one for each world") from None  # fmt: skip
    checked = np.asarray(array(where, numbers[..., None], 1)[..., 0])
    if name.endswith(NOT_NEGATIVE) and (checked < 0.0).any():
        raise SceneError(f"no body has {float(checked.min()):g}", where=where, argument="parameters",
                         remedy="give numbers of at least 0")  # fmt: skip
    return checked


def close_loops(equations: Equations, states: np.ndarray) -> None:
    """Move the starts onto the loops, in place. Raises SceneError with the world that cannot be closed."""
    if equations.constraints is None:
        return
    for world in range(states.shape[1]):
        try:
            states[:, world] = assembled(equations.constraints, states[:, world])
        except SceneError as error:
            raise SceneError(error.what, where=f"world {world}", remedy=error.remedy) from None
