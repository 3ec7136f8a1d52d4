"""Scene: a robot, an initial state by joint name, and the effects that act on it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from twolink.dynamics import Robot, load_robot
from twolink.dynamics.arguments import array, by_joint, configuration, instance, positive
from twolink.effects import Effect
from twolink.effects.checks import check_effect, with_plain_numbers
from twolink.effects.constants import Constants
from twolink.effects.loops import Loop
from twolink.effects.quantities import in_si
from twolink.errors import AccuracyError, SceneError, TwolinkError
from twolink.io.files import path_to_write
from twolink.io.text import facts_html
from twolink.robots.checks import weightless_joints
from twolink.robots.collisions import Shape
from twolink.robots.joining import pose_of
from twolink.robots.meshes import VisualModel
from twolink.scenes.file_format import ObjectEntry, save_scene
from twolink.scenes.objects import with_objects

if TYPE_CHECKING:
    from twolink.effects.sensors import Sensor

_T = TypeVar("_T")
MANY_TURNS = 2 * math.pi  # rad, from which on an angle may have been meant in degrees
_REMEDY = "such as [tl.effects.Gravity()]"
_OWN = "one of your own is a class that derives from tl.effects.Effect"


def start_notes(robot: Robot, q: np.ndarray) -> list[str]:
    """Possible mistakes in a start q (nq,): joints beyond the URDF's limits, angles that may be in degrees."""
    notes = []
    for joint in robot.joints:
        if joint.kind != "vector":
            continue
        value, angle = float(q[joint.q.start]), joint.unit == "rad"
        lower, upper = joint.lower[0], joint.upper[0]
        unit = "rad" if angle else "m"
        note = ""
        if not lower <= value <= upper:
            note = f", beyond the limits {lower:.4g} to {upper:.4g} {unit} of the URDF"
        if angle and abs(value) > MANY_TURNS:
            note += f"; angles are in radians: {value:.4g} degrees are {math.radians(value):.4g} rad"
        if note:
            notes.append(f"{joint.name} starts at {value:.4g} {unit}{note}")
    return notes


def duration_of(value: float) -> float:
    """A duration as a float: finite, above 0 [s]."""
    return positive(value, "duration", SceneError, "such as 10.0", expected="a time above 0 s")


def accuracy_of(value: float) -> float:
    """An accuracy as a float: finite, above 0."""
    return positive(value, "accuracy", AccuracyError, "such as 1e-6")


class Scene:
    """A robot, its initial state and the effects that act on it. Nothing is on by default, gravity included.

    A scene does not change once it is made. It can be pickled, and compares by identity.

    Parameters
    ----------
    robot : Robot
        From `tl.load_robot`. Its own gravity does not count: a `tl.effects.Gravity` among the effects does.
    q, v : array_like or mapping of joint to array_like, optional
        Initial configuration (nq,) and velocity (nv,), or values of some joints by name (a continuous joint's may be
        its angle); rad, m, per second. Neutral and at rest by default, objects at their poses.
    effects : sequence of Effect
        What acts on the robot, in order.
    duration : float
        Time to simulate [s] where `simulate` is called without one.
    title : str
        One line on what the scene shows.

    Attributes
    ----------
    robot : Robot
        The robot with the constants that the effects change: gravity (none: zero), payloads, rotors.
    base : Robot
        The robot that the scene was made with.
    q : ndarray
        Initial configuration (nq,), read-only.
    v : ndarray
        Initial velocity (nv,), read-only.
    effects : tuple of Effect
        The effects.
    duration : float
        Time to simulate [s].
    title : str
        One line on what the scene shows.

    Raises
    ------
    SceneError
        An effect does not fit the robot (`where` names its index and field), or would change it once more, as another
        scene has (code "changed-twice"); or an argument is of the wrong kind.
    QueryError
        A state is not finite, or of the wrong shape.
    """

    export_fmu: ClassVar[Callable[..., Path]]  # from the room `exchange`, which stands above

    def __init__(
        self,
        robot: Robot,
        q: ArrayLike | Mapping[str, ArrayLike] | None = None,
        v: ArrayLike | Mapping[str, ArrayLike] | None = None,
        effects: Sequence[Effect] = (),
        duration: float = 10.0,
        title: str = "",
    ) -> None:
        instance(robot, Robot, "robot", SceneError).require_inertia()
        checked = _checked(effects, robot)
        _require_unchanged(robot, checked)

        def change(model: pin.Model) -> None:
            model.gravity.linear = np.zeros(3)
            for effect in checked:
                effect.change(model)

        q, v = (by_joint(robot, name, x or {}, SceneError) if x is None or isinstance(x, Mapping) else x
                for name, x in (("q", q), ("v", v)))  # fmt: skip
        start = configuration("q", q, robot.nq, robot.joints)
        velocity = array("v", v, robot.nv)
        self.base, self.robot = robot, robot.changed(change)
        _require_inertia(self.robot, checked)
        self.robot.changed_by += tuple(repr(effect) for effect in checked if effect.changes)
        self.q, self.v = _one_state("q", start, robot.nq), _one_state("v", velocity, robot.nv)
        self.effects, self.duration = checked, duration_of(duration)
        self.title = title

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse changes after `title` is set, the last one: what was computed from the scene would not be true."""
        if hasattr(self, "title"):
            remedy = "make another: tl.Scene(...)"
            raise SceneError("a scene cannot be changed", where=name, remedy=remedy, code="frozen")
        super().__setattr__(name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene, (self.base, self.q, self.v, self.effects, self.duration, self.title)

    @property
    def sensors(self) -> dict[str, Sensor]:
        """The sensors among the effects, by name."""
        return {effect.label: effect for effect in self.effects if effect.is_sensor}  # type: ignore[attr-defined, misc]

    def notes(self) -> list[str]:
        """Notes on possible mistakes in the start, and those of the effects on themselves, one line each."""
        of_effects = [note for effect in self.effects for note in effect.notes(self.robot)]
        return [*start_notes(self.base, self.q), *of_effects]

    def without(self, effect: int | str | type[Effect]) -> Scene:
        """A copy of the scene without one of its effects, given by its place, or without all of a kind.

        Parameters
        ----------
        effect : int, str or class
            Its place among `effects`, or a class or its name: `effects.Gravity`, "Gravity".

        Raises
        ------
        SceneError
            The scene has no such effect; code "no-effect".
        """
        name = effect.__name__ if isinstance(effect, type) else effect
        kept = [one for i, one in enumerate(self.effects) if name not in (i, i - len(self.effects), type(one).__name__)]
        if len(kept) == len(self.effects):
            names = ", ".join(type(one).__name__ for one in self.effects) or "none"
            raise SceneError(f"no effect {name!r}; the scene has {names}", where="effects",
                             remedy="give the place of an effect, its class or its name", code="no-effect")  # fmt: skip
        return self.with_effects(kept)

    def with_effects(self, effects: Sequence[Effect]) -> Scene:
        """A copy of the scene with other effects."""
        return Scene(self.base, self.q, self.v, effects, self.duration, self.title)

    def with_object(
        self,
        source: Robot | Shape | str | os.PathLike[str],
        pose: ArrayLike | pin.SE3 = (0.0, 0.0, 0.0),
        *,
        mass: float | None = None,
        name: str = "",
        root: Literal["fixed", "free"] | None = None,
    ) -> Scene:
        """A copy of the scene with another robot or object beside the robot; `scene.base.report` says what was joined.

        Parameters
        ----------
        source : Robot, shape, str or path
            A robot, or what `load_robot` takes; a shape such as `tl.effects.Box`; or a mesh file. Bundled objects are
            "ball", "box", "can" and "plank".
        pose : array_like or pin.SE3
            The position (3,) of its root link in the world, m, or position and quaternion x y z w (7,).
        mass : float, optional
            Of a shape or mesh, which it fills evenly, kg; without it the shape is fixed to the world.
        name : str
            By default that of the robot, file or shape, with a number where it is taken. An object that is free has a
            joint of this name, whose configuration is its pose in the world.
        root : {"fixed", "free"}, optional
            By default a robot is free if it was loaded so, and one without joints too; of the catalogue, if it usually
            is.

        Returns
        -------
        Scene
            The scene, at the same state, with the object at rest at its pose.

        Raises
        ------
        RobotError
            The object cannot be loaded, its name is taken, or a mass is not above 0 or of what has one of its own.
        """
        at = pin.SE3ToXYZQUAT(pose_of(pose)).tolist()
        entry = ObjectEntry(source, tuple(at), mass, name, root)  # type: ignore[arg-type]
        robot = with_objects(self.base, [entry], lambda it: load_robot(it.source))
        q, v = ({joint.name: x[part] for joint in self.base.joints if (part := getattr(joint, key)).stop > part.start}
                for key, x in (("q", self.q), ("v", self.v)))  # fmt: skip
        return Scene(robot, q, v, self.effects, self.duration, self.title)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the scene to a file that `load_scene` reads again.

        Parameters
        ----------
        path : str or path
            A file that ends in .toml. A robot of the catalogue is written by its name; any other one as a URDF beside
            the file: STEM.urdf, or STEM-robot.urdf where that is another file.

        Returns
        -------
        Path
            The path.

        Raises
        ------
        SceneError
            The path ends otherwise, an effect holds a function, or other files have these names; the robot's constants
            were changed after it was loaded (code "robot-differs"), or its joints follow others (mimic=True).
        """
        return save_scene(path_to_write(path), self.base, self.q, self.v, self.effects, self.duration, self.title)

    def visual_model(self, *, tree: bool = True) -> VisualModel:
        """The robot's shapes to draw, as `Robot.visual_model` has them, and what effects have fixed to the world."""
        visuals = self.robot.visual_model(tree=tree)
        for piece in (piece for effect in self.effects for piece in effect.pieces()):
            visuals.addGeometryObject(piece)
        return visuals

    def with_start(self, q: ArrayLike, v: ArrayLike) -> Scene:
        """A copy of the scene with another start q (nq,), v (nv,)."""
        return Scene(self.base, q, v, self.effects, self.duration, self.title)

    def with_held_torques(self) -> tuple[Scene, tuple[str, ...]]:
        """The scene with torques of all degrees of freedom that are numbers of a state, and their names."""
        from twolink.effects.inputs import Slot  # which other scenes do not load
        from twolink.effects.sampled_control import DofTorques

        names = tuple(f"torque {k}" for k in range(self.robot.nv))
        return self.with_effects([*self.effects, DofTorques({name: Slot(name) for name in names})]), names

    def _summary(self) -> dict[str, str]:
        """The scene's summary for people, by name."""
        robot = self.robot
        return {
            "robot": f"{robot.name}, nq = {robot.nq}, nv = {robot.nv}, {robot.mass:.4g} kg",
            "q": _shown(self.q),
            "v": _shown(self.v),
            "effects": ", ".join(map(_named, self.effects)) or "none: free motion",
            "duration": f"{self.duration:g} s",
        }

    def __repr__(self) -> str:
        lines = [f"Scene{f': {self.title}' if self.title else ''}"]
        return "\n".join([*lines, *(f"  {name:<10}{text}" for name, text in self._summary().items())])

    def _repr_html_(self) -> str:
        return facts_html(self.title or "Scene", {name: [text] for name, text in self._summary().items()})


def _named(effect: Effect) -> str:
    """The effect's name, with the period of what ticks: it may have been left out."""
    clock: Any = effect if effect.is_sensor else effect.sampled
    return type(effect).__name__ + (f" (every {float(clock.period):g} s)" if clock is not None else "")


def fall_notes(scene: Scene) -> list[str]:
    """A note where gravity pulls what is free and nothing holds: such a motion may be a plain fall."""
    free = [joint.name for joint in scene.robot.joints if joint.kind == "free-flyer"]
    held = any(effect.touches or isinstance(effect, Loop) for effect in scene.effects)
    what = "is free and touches nothing: but for forces of effects, it falls; a ground: --ground"
    falls = free and not held and scene.robot.model.gravity.linear.any()
    return [f"joint {free[0]!r} {what}, or scene_of(..., contact=True)"] if falls else []


def _shown(state: np.ndarray) -> str:
    return ", ".join(f"{x:.4g}" for x in state[:8]) + (f", ... ({state.size} numbers)" if state.size > 8 else "")


def _one_state(name: str, value: np.ndarray, size: int) -> np.ndarray:
    """A read-only copy of one state (size,)."""
    if value.shape != (size,):
        what = f"expected one state of shape ({size},), got {value.shape}"
        raise SceneError(what, where=name, remedy="a scene has one initial state", argument=name)
    state = value.copy()
    state.flags.writeable = False
    return state


def _require_unchanged(robot: Robot, effects: Sequence[Effect]) -> None:
    """Refuse the robot of another scene where an effect would change its constants once more, such as add a rotor."""
    for i, effect in enumerate(effects):
        if robot.changed_by and effect.changes and repr(effect) in robot.changed_by:
            again = robot.model.copy()
            effect.change(again)
            if again != robot.model:
                what = f"the robot has been changed by this {type(effect).__name__} already, which would act twice"
                raise SceneError(what, where=f"effects[{i}]", remedy="give scene.base, not scene.robot; or use "
                                 "scene.with_effects(...)", argument="robot", code="changed-twice")  # fmt: skip


def _require_inertia(robot: Robot, effects: Sequence[Effect]) -> None:
    """Require that joints still move an inertia where constants are 0. Raises SceneError, code "no-inertia"."""
    for i, effect in enumerate(effects):
        zero = isinstance(effect, Constants) and 0.0 in effect.values.values()
        if zero and (names := weightless_joints(robot.model)):
            what = f"joint {names[-1]!r} then moves no inertia, so that its acceleration is not determined"
            raise SceneError(what, where=f"effects[{i}].values", remedy="give what it moves a mass and an inertia, or "
                             "load the robot with the joint locked", code="no-inertia")  # fmt: skip


def _checked(effects: Sequence[Effect], robot: Robot) -> tuple[Effect, ...]:
    """The effects, after each was checked against the robot: its joints and frames exist."""
    if isinstance(effects, Effect) or not isinstance(effects, Sequence):
        what = f"expected a list of effects, got {type(effects).__name__}"
        raise SceneError(what, where="effects", remedy=_REMEDY, argument="effects")
    for effect in effects:
        if not isinstance(effect, Effect):
            what, remedy = f"expected effects, got {type(effect).__name__}", f"{_REMEDY}; {_OWN}"
            if isinstance(effect, type):
                what, remedy = f"expected effects, got the class {effect.__name__}", f"write {effect.__name__}(...)"
            raise SceneError(what, where="effects", remedy=remedy, argument="effects")
    given, effects = effects, tuple(map(with_plain_numbers, effects))
    if sum(type(effect).__name__ == "Gravity" for effect in effects) > 1:
        raise SceneError("gravity is given twice", where="effects", remedy="keep one", argument="effects")
    first: dict[int, int] = {}
    for i, effect in enumerate(given):
        if (before := first.setdefault(id(effect), i)) != i:
            what = f"this {type(effect).__name__} is effects[{before}] already"
            raise SceneError(what, where=f"effects[{i}]", remedy="leave it out; to act twice, it is made twice",
                             argument="effects", effect=i)  # fmt: skip
    names = [effect.label for effect in effects if effect.is_sensor]  # type: ignore[attr-defined]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise SceneError(f"two sensors are called {twice!r}", where="effects", remedy="give one a name=",
                         argument="effects")  # fmt: skip

    def beside_others(effect: Effect) -> None:
        effect.check_beside(effects, robot)
        if effect.sampled is not None:
            effect.sampled.check_inputs([*robot.frame_names, *names])

    effects = tuple(_each(effects, lambda effect: in_si(effect, robot)))
    for check in (lambda effect: check_effect(effect, robot), beside_others):
        _each(effects, check)
    return effects


def _each(effects: Sequence[Effect], call: Callable[[Effect], _T]) -> list[_T]:
    """The answers of a function to the effects; failures name the place of the effect."""
    answers = []
    for i, effect in enumerate(effects):
        try:
            answers.append(call(effect))
        except TwolinkError as error:
            raise at_effect(error, i) from None
    return answers


def at_effect(error: TwolinkError, index: int) -> TwolinkError:
    """The failure with the place of the effect before its own; its data has the index as `effect`."""
    joint = "." if isinstance(error, SceneError) else ", "
    where = f"effects[{index}]{joint}{error.where}" if error.where else f"effects[{index}]"
    return error.at(where, SceneError, argument="effects", effect=index)
