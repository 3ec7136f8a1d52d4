"""The cause of a trajectory's deviation from the solution: the first of a list that leaves nothing, in time.

A cause is another law of motion, or another way of stepping. What it leaves unexplained is the share of the local
defects, or of the distance, that remains with it.
"""

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot
from twolink.effects import Effect
from twolink.effects.constants import Gravity
from twolink.effects.forces import JointDamping
from twolink.effects.joint_switches import DryFriction, JointStops
from twolink.effects.triggers import Watch
from twolink.errors import TwolinkError
from twolink.integrate.motion.scene_equations import equations_of
from twolink.io.progress import Report
from twolink.io.text import kebab_case
from twolink.parts.referee.local_errors import IMPLICIT, IMPLICIT_DAMPING, STEPPERS, Intervals, flow_of, viscosity
from twolink.parts.referee.trajectory_log import Array
from twolink.scenes import Scene
from twolink.simulation.time_limit import OutOfTime

EXPLAINS = 0.01  # a cause that leaves less is named
CLEAR = 1e-4  # of a cause without fitted numbers
ALIKE, ROUNDING = 10.0, 1e-5  # two that leave as little, within this factor or both below that, are not told apart
LIKELY, REFINED = 0.3, 3  # the share from which on fitted numbers are refined, and how often
SUBSTEPS = (1, 2, 4, 5, 8, 10, 20)
Look = tuple[str, Callable[[], Iterable["Cause"]]]
"""What is looked for, and the causes that are found."""
_WORDS = {"JointDamping": "damping", "DryFriction": "friction", "SmoothFriction": "friction", "JointSpring": "a spring"}


@dataclass(frozen=True)
class Cause:
    """A possible cause, the share that it leaves unexplained, and the count of numbers that were fitted for that."""

    what: str
    unexplained: float
    fitted: int = 0

    def __str__(self) -> str:
        return f"{self.what} (leaves {100 * self.unexplained:.2g} % unexplained)"


def look_for(looks: Sequence[Look], progress: Report | None) -> tuple[list[Cause], tuple[str, ...]]:
    """The causes that are found until one is clear, or the time is up; and what was not looked at for that."""
    found: list[Cause] = []
    for k, (name, look) in enumerate(looks):
        if progress is not None:
            progress(float(k), float(len(looks)), f"looking for a cause: {name}")
        try:
            found += look()
        except (OutOfTime, KeyboardInterrupt):
            return found, tuple(name for name, _ in looks[k:])
        if is_clear(found):
            break
    return found, ()


def is_clear(found: Sequence[Cause]) -> bool:
    """True if a cause leaves next to nothing, without fitted numbers: then none other is looked for."""
    return any(not cause.fitted and cause.unexplained < CLEAR for cause in found)


def named(found: Sequence[Cause]) -> tuple[tuple[Cause, ...], Cause | None]:
    """The cause that is named, with those that the motion does not tell it from, best first; else the nearest one."""
    ranked = sorted((cause for cause in found if cause.unexplained < 1.0), key=lambda cause: cause.unexplained)
    if not ranked or ranked[0].unexplained >= EXPLAINS:
        return (), ranked[0] if ranked else None
    least = max(ALIKE * ranked[0].unexplained, ROUNDING)
    alike = [cause for cause in ranked if cause.unexplained <= min(least, EXPLAINS)]
    return tuple(sorted(alike, key=lambda cause: cause.fitted)), None


def looks_at(few: Intervals) -> list[Look]:
    """The searches for causes that local defects can show."""
    looks: list[Look] = [("ways of stepping", lambda: _steppers(few, few.scene)),
                         ("effects that are left out", lambda: _left_out(few))]  # fmt: skip
    if equations_of(few.scene).constraints is None and not few.scene.robot.has_mimic:
        looks += [(f"whether {one.words}", functools.partial(_fitted, few, one)) for one in _offsets(few.scene.robot)]
    return looks


def _share(left: Array, before: Array) -> float:
    """The share of the defects that is left."""
    size = float(np.linalg.norm(before))
    return float(np.linalg.norm(left)) / size if np.isfinite(left).all() and size > 0 else np.inf


def _steppers(few: Intervals, scene: Scene, without: str = "") -> Iterator[Cause]:
    """Other ways of stepping, with steps that the samples are multiples of; the best of each."""
    h, also = float(np.median(few.h)), f", and {without} is left out" if without else ""
    damped, bound = viscosity(scene).any(), equations_of(scene).constraints is not None or scene.robot.has_mimic
    for name in filter(None, STEPPERS):
        if (name == IMPLICIT_DAMPING and not damped) or (name in (IMPLICIT, IMPLICIT_DAMPING) and bound):
            continue
        best = Cause("", np.inf)
        for count in SUBSTEPS:
            try:
                left = few.defects(flow_of(scene, name, count, check=few.check))
            except TwolinkError as error:
                if isinstance(error, OutOfTime):
                    raise
                continue  # such steps leave the finite numbers
            share = _share(left, few.exact)
            if share < best.unexplained:
                best = Cause(f"{name} with steps of {1e3 * h / count:.4g} ms{also}", share)
        yield best


def _left_out(few: Intervals) -> Iterator[Cause]:
    """The scene without one of its effects, alone or with another way of stepping."""
    for i, effect in enumerate(few.scene.effects):
        if isinstance(effect, JointStops | Watch):
            continue
        name = _WORDS.get(type(effect).__name__, kebab_case(type(effect).__name__).replace("-", " "))
        try:
            scene = few.scene.without(i)
            share = _share(few.exact_for(scene), few.exact)
        except OutOfTime:
            raise
        except TwolinkError:  # without it the scene is none
            continue
        yield Cause(f"{name} is left out", share)
        if 1e-3 < share < 0.7:
            yield from _steppers(few, scene, name)


@dataclass(frozen=True)
class ParameterOffset:
    """Numbers that may differ: in words, their names ("" where they say nothing), their place in the torques, and the
    scene with so much more of them.

    columns: of intervals, the torques (n, nv, k) that numbers of size 1 add.
    """

    words: str
    names: tuple[str, ...]
    columns: Callable[[Intervals], Array]
    changed: Callable[[Scene, Array], Scene]


def _offsets(robot: Robot) -> Iterator[ParameterOffset]:
    """Gravity; damping, friction and armature of joints; and the inertia of each body."""
    yield ParameterOffset("gravity differs [m/s^2]", ("x", "y", "z"), _pull, _with_gravity)
    names = robot.parameter_names
    single = [joint.name for joint in robot.joints if joint.v.stop - joint.v.start == 1]
    laws = (("damping", "N m s or N s/m", _with_damping), ("friction", "N m or N", _with_friction),
            ("armature", "kg m^2 or kg", _with_armature))  # fmt: skip
    for kind, unit, change in laws if single else ():
        own = [names.index(f"{joint}.{kind}") for joint in single]
        yield ParameterOffset(f"{kind} differs [{unit}]", tuple(single), functools.partial(_regressor, own),
                              functools.partial(change, single))  # fmt: skip
    for body in range(sum(name.endswith(".mass") for name in names)):
        own = list(range(10 * body, 10 * body + 10))
        link = names[own[0]].removesuffix(".mass")
        yield ParameterOffset(f"the mass or inertia of link {link} differs", ("",) * 10,
                              functools.partial(_regressor, own), functools.partial(_with_body, body + 1))  # fmt: skip


def _middle(few: Intervals) -> tuple[Array, Array, Array]:
    """q, v and a halfway through the intervals."""
    q = few.scene.robot.integrate(few.start.q, 0.5 * few.scene.robot.difference(few.start.q, few.end.q))
    return q, 0.5 * (few.start.v + few.end.v), (few.end.v - few.start.v) / few.h[:, None]


def _pull(few: Intervals) -> Array:
    q = _middle(few)[0]
    return -np.stack([few.scene.robot.with_gravity(g).gravity_torque(q) for g in np.eye(3)], axis=2)


def _regressor(own: list[int], few: Intervals) -> Array:
    return -few.scene.robot.regressor(*_middle(few))[:, :, own]


def _with_gravity(scene: Scene, more: Array) -> Scene:
    others = [effect for effect in scene.effects if not isinstance(effect, Gravity)]
    field: Any = tuple((np.array(scene.robot.model.gravity.linear) + more).tolist())
    return scene.with_effects([Gravity(field), *others])


def _with_more(kind: type[Effect], now: Array, joints: list[str], scene: Scene, more: Array) -> Scene:
    """The scene with one effect of a kind in the place of its own, which add up to `now` (nv,)."""
    others = [effect for effect in scene.effects if not isinstance(effect, kind)]
    total = np.maximum(now[_dofs(scene, joints)] + more, 0.0).tolist()
    return scene.with_effects([*others, kind(dict(zip(joints, total, strict=True)))])


def _with_damping(joints: list[str], scene: Scene, more: Array) -> Scene:
    return _with_more(JointDamping, viscosity(scene), joints, scene, more)


def _with_friction(joints: list[str], scene: Scene, more: Array) -> Scene:
    now = np.zeros(scene.robot.nv)
    for effect in scene.effects:
        if isinstance(effect, DryFriction):
            for hold in effect.modes(scene.base):
                now[hold.dof] += hold.kinetic
    return _with_more(DryFriction, now, joints, scene, more)


def _with_armature(joints: list[str], scene: Scene, more: Array) -> Scene:
    def change(model: pin.Model) -> None:
        model.armature[_dofs(scene, joints)] += more

    return Scene(scene.base.changed(change), scene.q, scene.v, scene.effects)


def _with_body(body: int, scene: Scene, more: Array) -> Scene:
    def change(model: pin.Model) -> None:
        model.inertias[body] = pin.Inertia.FromDynamicParameters(model.inertias[body].toDynamicParameters() + more)

    return Scene(scene.base.changed(change), scene.q, scene.v, scene.effects)


def _dofs(scene: Scene, joints: list[str]) -> list[int]:
    return [joint.v.start for joint in scene.robot.joints if joint.name in joints]


def _fitted(few: Intervals, offset: ParameterOffset) -> Iterator[Cause]:
    """The numbers by least squares of the torques M dv / h that are missing, and refined by Gauss and Newton's method.

    Refined, the share is that of the exact motion with these numbers, as of every other cause.
    """
    if "friction" in offset.words:  # which is smooth where no velocity changes its sign
        same = np.all(few.start.v * few.end.v > 0.0, axis=1)
        if same.sum() < 3:
            return
        few = few if same.all() else few.part(same)
    columns, total, left = offset.columns(few), np.zeros(len(offset.names)), few.exact
    flat = columns.reshape(-1, columns.shape[2])
    scale = np.linalg.norm(flat, axis=0)
    scale[scale <= 1e-9 * scale.max(initial=0.0)] = np.inf  # what this motion does not show
    mass, nv, best = few.scene.robot.mass_matrix(few.start.q), few.scene.robot.nv, np.inf
    for round_ in range(1 + REFINED):
        missing = np.einsum("nij,nj->ni", mass, left[:, nv:] / few.h[:, None]).ravel()
        found = np.linalg.lstsq(flat / scale, missing, rcond=1e-9)[0]
        if round_ == 0:
            best = _share(missing - flat / scale @ found, missing)
        numbers = total + found / scale
        if best > LIKELY:
            total = numbers
            break
        try:
            left = few.exact_for(offset.changed(few.scene, numbers))
        except OutOfTime:
            raise
        except (TwolinkError, ValueError):  # no robot has such numbers
            break
        share = _share(left, few.exact)
        if round_ and share > 0.5 * best:
            break
        best, total = share, numbers
    told = [f"{name} {x:+.3g}" for name, x in zip(offset.names, total, strict=True)
            if name and abs(x) > 1e-2 * np.abs(total).max()]  # fmt: skip
    yield Cause(": ".join([offset.words, *filter(None, [", ".join(told)])]), best, int(np.isfinite(scale).sum()))
