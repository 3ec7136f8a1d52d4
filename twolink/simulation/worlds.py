"""simulate_many: one scene, many initial states and physical constants, each world with steps of its own."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.algorithms.mechanism import parameter_names
from twolink.dynamics import Robot
from twolink.dynamics.arguments import array, configuration
from twolink.dynamics.kernels import heyoka
from twolink.effects.switching import SwitchingEffect
from twolink.errors import AccuracyError, MissingExtraError, SceneError, nearest
from twolink.integrate.assembly import assembled
from twolink.integrate.equations import Equations
from twolink.integrate.method_choice import SAFETY, first_tolerance, second_tolerance
from twolink.integrate.methods import METHODS
from twolink.integrate.perturbation import second_solution
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solution import Progress
from twolink.integrate.solver import smallest_tolerance
from twolink.integrate.step_map import StepMap, step_map
from twolink.integrate.stepping import integrate_many
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of, duration_of
from twolink.simulation.trajectory import Cost

LOOKS = 16  # times on the way at which errors are taken, besides those asked for
MAX_NUMBERS = 200_000_000


@dataclass(frozen=True)
class Worlds:
    """Where many worlds ended: q (n, nq), v (n, nv) at time t [s].

    error (n,): the estimated global error of each, rad or m; NaN for a world that was lost (its step size collapsed or
    its state stopped being finite: its q and v are NaN too); None when not verified. kept (n,): whether the error is
    below the accuracy. steps (n,): of each world. samples_t (m,), samples_q (m, n, nq), samples_v (m, n, nv): on the
    way, where they were asked for.
    """

    robot: Robot
    t: float
    q: np.ndarray
    v: np.ndarray
    error: np.ndarray | None
    accuracy: float
    steps: np.ndarray
    cost: Cost
    samples_t: np.ndarray
    samples_q: np.ndarray
    samples_v: np.ndarray

    @property
    def kept(self) -> np.ndarray | None:
        """Whether each world's error bar is below the accuracy asked for; None: not verified."""
        return None if self.error is None else self.error <= self.accuracy

    def __repr__(self) -> str:
        kept = "not verified" if self.kept is None else f"{int(self.kept.sum())} within {self.accuracy:g}"
        return f"<Worlds of {self.robot.name!r}: {len(self.q)} at {self.t:g} s, {kept}>"


def simulate_many(
    scene: Scene,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    duration: float | None = None,
    accuracy: float = 1e-6,
    *,
    samples: int = 0,
    verify: bool = True,
    progress: Progress | None = None,
) -> Worlds:
    """Simulate n worlds of a scene at once, to the same time.

    q (n, nq), v (n, nv): initial states; the scene's own where left out. parameters: physical constants by name
    (`dynamics.mechanism.parameter_names`: "forearm.mass", ...), a number or one for each world. samples: how many
    equally spaced times to keep besides the last. accuracy, verify: as in `simulate`; worlds whose error bar is above
    the accuracy are solved again with smaller tolerances, and what is still above is reported in `error`.

    Raises SceneError for what does not fit, and AccuracyError for an accuracy out of reach.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"expected a Scene, got {type(scene).__name__}", where="scene", remedy="tl.load_scene(...)")
    accuracy = accuracy_of(accuracy)
    if any(isinstance(effect, SwitchingEffect) for effect in scene.effects):
        raise SceneError("worlds of a batch do not locate events yet", where="effects",
                         remedy="simulate them one by one: tl.simulate")  # fmt: skip
    end = scene.duration if duration is None else duration_of(duration)
    states, values = _worlds(scene, q, v, parameters)
    _require_samples(samples, states.shape)
    compiled = _map(scene, tuple(values), end)
    _close_loops(compiled.equations, states, bool(values))
    rows = np.array([values[name] for name in values]) if values else None
    times = np.linspace(0.0, end, samples + 2) if samples else np.array([0.0, end])
    looked = np.union1d(times, np.linspace(0.0, end, LOOKS + 1))  # an error may vanish at the end alone
    tolerance = first_tolerance(compiled.method, accuracy)
    if verify and second_tolerance(compiled.method, tolerance) < smallest_tolerance(compiled.method):
        raise AccuracyError(f"{accuracy:g} is below what can be verified in batches", where="accuracy",
                            remedy="ask for 1e-12 or more, or verify=False")  # fmt: skip
    start = time.perf_counter()
    found, steps, rejected = integrate_many(compiled, states, looked, tolerance, rows, progress)
    seconds = time.perf_counter() - start
    error: np.ndarray | None = None
    if verify:
        error = _verified(compiled, states, looked, tolerance, rows, accuracy, found, steps)
    cost = Cost(
        compiled.method.name, tolerance, int(steps.sum()), int((steps + rejected).sum()) * compiled.method.evaluations,
        seconds, time.perf_counter() - start - seconds, compiled.compile_seconds, compiled=compiled.compiled,
        why="a batch",
    )  # fmt: skip
    asked = np.searchsorted(looked, times)
    qs, vs = _split(compiled.equations, found[asked])
    kept = slice(0, samples + 1 if samples else 0)
    return Worlds(scene.robot, end, qs[-1], vs[-1], error, accuracy, steps, cost, times[kept], qs[kept], vs[kept])


def _split(equations: Equations, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(q (m, n, nq), v (m, n, nv)) of states (m, size, n); q on its manifold, NaN for a world that is lost."""
    by_world, space = np.moveaxis(found, 2, 1), equations.space
    q, v = by_world[..., : space.nq].copy(), by_world[..., space.nq : equations.moving]
    if space.curved:
        fine = np.isfinite(q).all(axis=-1)
        q[fine] = space.robot.normalize(q[fine])
    return q, v


def _require_samples(samples: int, shape: tuple[int, ...]) -> None:
    if not isinstance(samples, (int, np.integer)) or isinstance(samples, bool) or samples < 0:
        raise SceneError(f"expected a whole number from 0, got {samples!r}", where="samples", remedy="such as 10")
    if samples * shape[0] * shape[1] > MAX_NUMBERS:
        raise SceneError(f"{samples:.1e} samples of {shape[1]} worlds are too many", where="samples",
                         remedy="ask for fewer, or for fewer worlds at once")  # fmt: skip


def _close_loops(equations: Equations, states: np.ndarray, parameters: bool) -> None:
    """Move the starts onto the loops, in place. Raises SceneError with the world that cannot be closed."""
    if equations.constraints is None:
        return
    if parameters:
        raise SceneError("worlds with loops cannot differ in their constants yet", where="parameters",
                         remedy="make a scene of each")  # fmt: skip
    for world in range(states.shape[1]):
        try:
            states[:, world] = assembled(equations.constraints, states[:, world])
        except SceneError as error:
            raise SceneError(error.what, where=f"world {world}", remedy=error.remedy) from None


def _map(scene: Scene, parameters: tuple[str, ...], end: float) -> StepMap:
    if parameters and heyoka() is None:
        raise MissingExtraError("parameters that differ by world need heyoka", remedy="pip install heyoka (Linux)")
    equations = equations_of(scene, parameters)
    equations.require(0.0, end)
    return step_map(equations, METHODS["dop853"])


def _verified(
    compiled: StepMap,
    states: np.ndarray,
    times: np.ndarray,
    tolerance: float,
    rows: np.ndarray | None,
    accuracy: float,
    found: np.ndarray,
    steps: np.ndarray,
) -> np.ndarray:
    """The error bar of each world (n,); worlds beyond the accuracy are solved again, into `found` and `steps`."""
    least = smallest_tolerance(compiled.method)
    error = np.full(states.shape[1], np.nan)
    going, current, perturbation = np.arange(states.shape[1]), found, second_solution()
    while True:
        own = None if rows is None else rows[:, going]
        perturbed = perturbation.shifted(states[:, going])
        tolerance = second_tolerance(compiled.method, tolerance)
        finer, *_ = integrate_many(compiled, perturbed, times, tolerance, own, min_steps=perturbation.min_steps)
        distance = SAFETY * _distance(compiled, current, finer)
        error[going], found[:, :, going] = distance, current
        going = going[distance > accuracy]  # not the lost ones, which are NaN
        if not going.size or second_tolerance(compiled.method, tolerance) < least:
            return error
        own = None if rows is None else rows[:, going]
        current, steps[going], _ = integrate_many(compiled, states[:, going], times, tolerance, own)


def _distance(compiled: StepMap, coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """The largest difference of q on the way, of each world (n,)."""
    space = compiled.equations.space
    worst = np.zeros(coarse.shape[2])
    for ours, theirs in zip(coarse[1:], fine[1:], strict=True):
        good = np.isfinite(ours).all(axis=0) & np.isfinite(theirs).all(axis=0)
        worst[~good] = np.nan
        worst[good] = np.fmax(worst[good], space.distance(space.rows(ours[:, good])[0], space.rows(theirs[:, good])[0]))
    return worst


def _worlds(scene: Scene, q: Any, v: Any, given: Any) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The initial states (size, n), and each parameter's values (n,)."""
    robot = scene.robot
    known = parameter_names(robot.model)
    if not (given is None or isinstance(given, Mapping)):
        raise SceneError(f"expected values by name, got {type(given).__name__}", where="parameters",
                         remedy='such as {"forearm.mass": [1.0, 2.0]}')  # fmt: skip
    parameters = {str(name): value for name, value in (given or {}).items()}
    for name in parameters:
        if name not in known:
            raise SceneError(f"there is no parameter {name!r}", where="parameters", remedy=nearest(name, known))
    qs = configuration("q", scene.q if q is None else q, robot.nq, robot.joints)
    vs = array("v", scene.v if v is None else v, robot.nv)
    values = {name: _values(name, value) for name, value in parameters.items()}
    try:
        shape = np.broadcast_shapes(qs.shape[:-1], vs.shape[:-1], *(a.shape for a in values.values()))
    except ValueError:
        sizes = {"q": qs.shape[:-1], "v": vs.shape[:-1], **{k: a.shape for k, a in values.items()}}
        raise SceneError(f"the worlds do not match: {sizes}", where="q, v, parameters",
                         remedy="give each one world, or the same number") from None  # fmt: skip
    if len(shape) > 1:
        raise SceneError(f"expected worlds (n,), got {shape}", where="q", remedy="reshape to (n, nq)")
    count = shape[0] if shape else 1
    if count == 0:
        raise SceneError("there are no worlds", where="q", remedy="give at least one")
    x = np.concatenate([np.broadcast_to(qs, (count, robot.nq)), np.broadcast_to(vs, (count, robot.nv))], axis=1)
    return np.ascontiguousarray(x.T), {k: np.broadcast_to(a, (count,)).copy() for k, a in values.items()}


def _values(name: str, given: Any) -> np.ndarray:
    """A parameter's values (...,): finite numbers that a body can have."""
    try:
        numbers = np.asarray(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"expected numbers, got {given!r:.60}", where=f"parameters[{name!r}]",
                         remedy="one, or one for each world") from None  # fmt: skip
    checked = array(f"parameters[{name!r}]", numbers[..., None], 1)[..., 0]
    least = (
        0.0 if name.endswith((".mass", ".armature", ".damping", ".inertia.xx", ".inertia.yy", ".inertia.zz")) else None
    )
    if least is not None and (checked < least).any():
        raise SceneError(f"no body has {float(checked.min()):g}", where=f"parameters[{name!r}]",
                         remedy="give numbers of at least 0")  # fmt: skip
    return np.asarray(checked)
