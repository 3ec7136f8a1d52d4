"""A scene's equations with one parameter moved a little, and the derivatives of constants by parameters.

A parameter is a physical constant of the robot or a number of an effect. Where it is no input of the equations itself,
it acts through constants that are: a payload's mass through the inertia of the link that carries it, a joint's dry
friction through the friction torque of a mode.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twolink.algorithms.dual_numbers import derivative
from twolink.algorithms.mechanism import mechanism, moments, nominal, parameter_names, with_nominal
from twolink.dynamics import Robot
from twolink.effects import Effect, JointDamping
from twolink.effects.loops import Loop
from twolink.effects.switching import Switching, SwitchingEffect, switching_of
from twolink.errors import SceneError
from twolink.integrate.motion.effect_numbers import contact_numbers, physical, with_effect_numbers
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.motion.state import Array
from twolink.scenes import Scene
from twolink.scenes.parameters import DAMPING, PREFIX, named_parameters, part_of, with_effect_number

STEP = 1e-3  # of differences by a parameter, relative; their error is its fourth power
SMALL = 1e-2  # SI units: a number of an effect below it, or a length, is moved as if it were this
NOTHING = 1e-5  # SI units: by which a physical constant is moved that is 0
NO_SLIP: Mapping[int, float] = {}


class _Moved(Effect, frozen=True):
    """A physical constant, moved after all other effects."""

    name: str
    by: float

    def change(self, model: Any) -> None:
        """Move it."""
        with_nominal(model, self.name, nominal(model, self.name) + self.by)


class ParameterVariation:
    """A scene with one of its parameters moved.

    names: the parameters. values: their own values in the scene. constants: the inputs that the equations need for
    them. has_friction: whether some act through the friction torques of modes.
    """

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        self.equations, self.names = equations_of(scene), tuple(names)
        self.values = [parameter.nominal for parameter in named_parameters(scene, self.names, "wrt")]
        self._own = self.equations.switching or Switching(scene.base, scene.robot, scene.effects)
        self._kept: dict[tuple[int, float], Switching] = {}
        released = any(isinstance(effect, SwitchingEffect) and any(inner.changes for inner in effect.acting())
                       for effect in scene.effects)  # fmt: skip
        self._through = [i for i, name in enumerate(self.names) if _changes(scene, name, released)]
        self._acting = [name for i, name in enumerate(self.names)
                        if (_acts(scene, name) if name.startswith(PREFIX) else i not in self._through)]  # fmt: skip
        modes = bool(self._own.locks or self._own.contacts)
        self._derives = [i for i in range(len(self.names)) if modes or i in self._through]
        for i, name in enumerate(self.names):
            for (_, pair), (_, moved) in zip(self._own.pairs, self._switching(i, 1).pairs, strict=True):
                if pair.content != moved.content:
                    raise SceneError(f"there are no derivatives by {name}, which acts through contacts of {pair.name}: "
                                     "they touch at points that change", where="wrt", code="sensitivity-undefined",
                                     remedy="ask for another parameter, or give spheres or capsules")  # fmt: skip
        changed = [name for i in self._derives for name, value in self._derived(i, 1).items()
                   if value != self._derived(i, 0)[name]]  # fmt: skip
        self.constants = tuple(dict.fromkeys([*self._acting, *changed]))
        beside = [zip(self._own.locks, self._switching(i, 1).locks, strict=True) for i in self._derives]
        self.has_friction = any(lock.kinetic != moved.kinetic for pairs in beside for (_, lock), (_, moved) in pairs)

    def step(self, i: int) -> float:
        """By how much parameter i is moved."""
        value, name = abs(self.values[i]), self.names[i]
        if name.startswith((PREFIX, "gravity")) or ".origin." in name or ".com." in name:
            return STEP * max(value, SMALL)
        return STEP * value if value else NOTHING

    def _switching(self, i: int, k: float) -> Switching:
        """Declarations of the effects, and the robot they act on, with parameter i moved by k steps."""
        if (i, k) not in self._kept:
            name, by, own = self.names[i], k * self.step(i), self._own
            effects = list(own.effects)
            if name.startswith(PREFIX):
                effects = with_effect_number(effects, name, self.values[i] + by)
            elif name.endswith(DAMPING):  # that of the model acts on nothing
                effects.append(JointDamping({name.removesuffix(DAMPING): by}))
            else:
                effects.append(_Moved(name, by))
            robot = own.robot_with(effects)
            self._kept[i, k] = switching_of(own.base, robot, effects) or Switching(own.base, robot, tuple(effects))
        return self._kept[i, k]

    def _robot(self, i: int, k: float, dropped: frozenset[int] = frozenset()) -> Robot:
        """The robot with parameter i moved by k steps, without the effects that act no more."""
        switching = self._switching(i, k)
        return switching.robot_with([effect for _, effect in switching.acting(dropped)])

    def equations_beside(self, i: int, k: float) -> Equations:
        """The equations with parameter i moved by k steps, from the same start."""
        switching, own, robot = self._switching(i, k), self.equations, self._robot(i, k)
        mech, acting = mechanism(robot.model), [effect for _, effect in switching.acting()]
        loops = tuple(effect for effect in acting if isinstance(effect, Loop))
        effects = tuple(effect for effect in acting if type(effect).act is not Effect.act)
        constraints = own.constraints and replace(own.constraints, mech=mech, loops=loops)
        return replace(own, robot=robot, mechanism=mech, effects=effects, constraints=constraints,
                       switching=switching)  # fmt: skip

    def gains(self, dropped: frozenset[int] = frozenset(), slip: Mapping[int, float] = NO_SLIP) -> Array:
        """The derivatives of friction torques, if `has_friction`, and of the constants, by the parameters (., p).

        dropped: places of effects that act no more. slip: the directions of joints that slip.
        """
        lockable = self.equations.layout.lockable if self.has_friction else ()

        def values(i: int, k: float) -> Array:
            locks, derived = self._switching(i, k).locks, self._derived(i, k, dropped)
            torques = [-slip.get(d, 0.0) * sum(h.kinetic for _, h in locks if h.dof == d) for d in lockable]
            return np.array(torques + [derived.get(name, 0.0) for name in self.constants])

        out = np.zeros((len(lockable) + len(self.constants), len(self.names)))
        for i, name in enumerate(self.names):
            if i in self._derives:
                out[:, i] = derivative(functools.partial(values, i), self.step(i))
            if name in self._acting:
                out[len(lockable) + self.constants.index(name), i] = 1.0
        return out

    def _derived(self, i: int, k: float, dropped: frozenset[int] = frozenset()) -> dict[str, float]:
        """The constants that parameter i, moved by k steps, may act through: of contacts, and of the robot."""
        derived = contact_numbers(self._switching(i, k))
        if i in self._through:
            model = self._robot(i, k, dropped).model
            derived.update({name: nominal(model, name) for name in parameter_names(model)})
        return derived


def shifted(equations: Equations, values: Mapping[str, float]) -> Equations:
    """The equations with other values of physical constants and of numbers of what acts, by name."""
    constants, equations = physical(values), with_effect_numbers(equations, values)
    damping = {name.removesuffix(DAMPING): constants.pop(name) for name in list(constants) if name.endswith(DAMPING)}
    if damping:  # that of the model acts on nothing
        equations = replace(equations, effects=(*equations.effects, JointDamping(damping)))
    if not constants:
        return equations

    def change(model: Any) -> None:
        for name, value in constants.items():
            with_nominal(model, name, value)

    robot = equations.robot.changed(change)
    mech = mechanism(robot.model)
    return replace(equations, robot=robot, mechanism=mech,
                   constraints=equations.constraints and replace(equations.constraints, mech=mech))  # fmt: skip


def _acts(scene: Scene, name: str) -> bool:
    """True if a number of an effect is an input of its `act`."""
    return type(_part(scene, name)).act is not Effect.act


def _changes(scene: Scene, name: str, released: bool) -> bool:
    """True if a parameter acts by constants of the robot. released: some of these change when it is released."""
    if name.startswith(PREFIX):
        return _part(scene, name).changes
    return (released and not name.endswith(DAMPING)) or name in moments(scene.robot.model)


def _part(scene: Scene, name: str) -> Effect:
    """The effect that has a number, or the one that is released."""
    _, place, *path = name.split(".")
    return part_of(scene.effects[int(place)], path)
