"""equilibria: configurations at which a robot stays at rest, found by Newton's method and classified.

Newton's method acts on the forces M a = tau - h: a itself has the mass matrix in it, which bends what springs give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics.arguments import array, configuration, instance, whole
from twolink.errors import CertificationError, SceneError
from twolink.integrate.motion.assembly import assembled
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.formulas import accelerations, unbalanced_forces
from twolink.integrate.motion.scene_equations import require_no_states
from twolink.integrate.motion.state import Array
from twolink.io.text import Table
from twolink.parts.design.linearization import AT_REST, Linearization, driven, linearize
from twolink.parts.design.smooth import allowed, derivatives_of, require_constant_forces
from twolink.scenes import Scene
from twolink.show.figure import Plotted, plot_eigenvalues
from twolink.simulation.text import BaseResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROUNDS, HALVINGS = 50, 6  # of Newton's method, and of a step that does not help
SMALL, ROUNDING = 1e-13, 1e-12  # rad or m: steps, and positions, that are rounding
STRIDE = 0.5  # rad or m: the longest step
RANK = 1e-8  # relative: singular values below it belong to directions in which equilibria go on
DRAWN = 64  # random configurations of which the one of the least potential energy is a start, too
MOST = 1e6  # starts
FEW = 6  # equilibria that a figure tells apart
SAME = 1e-6  # rad or m: equilibria nearer to each other are one
LEFT_OUT = "not-differentiable", "beyond-stop", "below-plane"  # codes of points that a search leaves out


@dataclass(frozen=True, eq=False, repr=False)
class Equilibria(BaseResult, Plotted, Sequence[Linearization]):
    """Equilibria, each as its linearization with the configuration `q` and its `stability`.

    Parameters
    ----------
    found : tuple of Linearization
        By the robot's potential energy, the lowest first.
    starts : int
        How many configurations Newton's method began from.
    failed : int
        From how many it found none.
    left_out : int
        Points at rest that are not listed: forces have no derivatives there, or they are beyond stops or planes.
    """

    found: tuple[Linearization, ...]
    starts: int
    failed: int
    left_out: int = 0

    def __getitem__(self, i):  # type: ignore[no-untyped-def]
        return self.found[i]

    def __len__(self) -> int:
        return len(self.found)

    def table(self) -> Table:
        """Configuration, stability, the largest real part of the eigenvalues with its error, and the residual."""
        rows = tuple((_shown(each.q, 6), each.stability, float(each.eigenvalues[0].real),
                      float(each.eigenvalue_errors[0]), float(np.abs(each.a).max(initial=0.0)))
                     for each in self.found)  # fmt: skip
        return Table(("q", "stability", "largest real part 1/s", "error", "|a|"), rows)

    def _figure(self) -> Figure:
        kinds: dict[str, list[Linearization]] = {}
        for each in self.found:  # by configuration, where there are few
            place = f"q = {_shown(each.q, 3)}: " if len(self) <= FEW else ""
            kinds.setdefault(f"{place}{each.stability}", []).append(each)
        sets = {name: (np.concatenate([one.eigenvalues for one in some]),
                       np.concatenate([one.eigenvalue_errors for one in some]))
                for name, some in kinds.items()}  # fmt: skip
        title = f"{self.found[0].robot.name}: " if self.found else ""
        return plot_eigenvalues(f"{title}eigenvalues at {len(self)} equilibria", sets)

    def __str__(self) -> str:
        head = f"{len(self.found)} equilibria from {self.starts} starts, {self.failed} of which led to none"
        if self.left_out:
            head += f"; {self.left_out} left out: beyond a stop or plane, or where forces have no derivatives"
        return f"{head}; there may be more\n{self.table()}"

    __repr__ = __str__


def _shown(q: np.ndarray, digits: int) -> str:
    """A configuration with so many digits, and 0 for rounding."""
    return ", ".join(f"{0.0 if abs(x) < ROUNDING else x:.{digits}g}" for x in q)


def equilibria(
    scene: Scene, q: ArrayLike | None = None, *, starts: int = 64, seed: int = 0, inputs: Sequence[str] = ()
) -> Equilibria:
    """Configurations at which a robot stays at rest, by Newton's method, and their stability.

        r(q) = M a = tau - h = 0 at v = 0,   dq = -(dr/dq)^+ r, shortened until the next step is shorter

    With closed loops r is a, differentiated along what the loops allow, and they are closed after every step.

    Parameters
    ----------
    scene : Scene
        The robot with its effects, whose forces must not depend on time.
    q : array_like (nq,), optional
        A guess: only the equilibrium that Newton's method finds from there. By default it begins from the scene's own
        configuration, the neutral one, random ones, and the lowest of many random ones.
    starts : int
        How many random ones.
    seed : int
        Of the random numbers.
    inputs : sequence of str, optional
        Actuated joints, for the controllability of each equilibrium; they bring no torque.

    Returns
    -------
    Equilibria
        A sequence of linearizations; angles are within a turn where forces allow it.

    Raises
    ------
    SceneError
        None was found from the guess (code "no-equilibrium"), forces depend on time, or as `linearize`.

    Notes
    -----
    All that were found are listed, which need not be all there are. Where equilibria form a line or a surface
    (dr/dq is singular), single points of it are listed, each of unknown stability. Joints that stops, dry friction or
    contacts hold at rest are not looked for, and those where forces have no derivatives, as on a limit of effort, or
    beyond stops and planes are left out.
    """
    equations, robot = _equations_at_rest(instance(scene, Scene, "scene", SceneError)), scene.robot
    if q is None:
        starts = whole(starts, "starts", SceneError, "such as 64", most=MOST)
        drawn = robot.random_state(max(starts, DRAWN), seed)[0]
        lowest = drawn[np.argmin(robot.energy(drawn, np.zeros((len(drawn), robot.nv)))[1])]  # near to hanging at rest
        guesses = np.concatenate([[scene.q], [robot.neutral], [lowest], drawn[:starts]])
    else:
        guesses = configuration("q", array("q", q, robot.nq), robot.nq, robot.joints).reshape(-1, robot.nq)
    points, could = _closed(equations, guesses)
    points, good = _newton(equations, points[could])
    distinct = _distinct(equations, points[good])
    found = _linearized(scene, distinct, inputs, search=q is None)
    if q is not None and not found:
        raise SceneError("Newton's method finds no equilibrium from there", argument="q", code="no-equilibrium",
                         remedy="give a nearer guess, or none: then it begins from many")  # fmt: skip
    found.sort(key=lambda each: float(robot.energy(each.q, each.v)[1]))
    return Equilibria(tuple(found), len(guesses), len(guesses) - int(good.sum()), len(distinct) - len(found))


def _equations_at_rest(scene: Scene) -> Equations:
    """The equations of the effects that act from the start. Raises SceneError."""
    equations = driven(scene, (), np.zeros(0))
    require_no_states(equations, "equilibria")
    require_constant_forces(equations, ": it has no equilibrium")
    waiting = equations.switching.idle_at(0.0)[1] if equations.switching else frozenset[int]()
    acting = [effect for place, effect in enumerate(scene.effects) if place not in waiting]
    return driven(scene.with_effects(acting), (), np.zeros(0)) if waiting else equations


def _linearized(scene: Scene, points: Sequence[Array], inputs: Sequence[str], *, search: bool) -> list[Linearization]:
    """The linearizations at those of the points that are equilibria.

    search: a point where forces have no derivatives, as on a limit of effort, or beyond a stop or a plane is left out;
    else it is an error.
    """
    found = []
    for point in points:
        try:
            found.append(linearize(scene, point, inputs=inputs))
        except CertificationError:  # differences see a limit of effort that derivatives do not
            if not (search and driven(scene, (), np.zeros(0)).effort_limits):
                raise
        except SceneError as error:
            if not (search and error.code in LEFT_OUT):
                raise
    return [each for each in found if each.is_equilibrium]


def _closed(equations: Equations, q: Array) -> tuple[Array, Array]:
    """Configurations (n, nq) with loops closed, and whether they could be (n,)."""
    out, could, still = q.copy(), np.ones(len(q), dtype=bool), np.zeros(equations.space.nv)
    if equations.constraints is None:
        return out, could
    for i, each in enumerate(q):
        try:
            out[i] = assembled(equations.constraints, np.concatenate([each, still]))[: equations.space.nq]
        except SceneError:
            could[i] = False
    return out, could


def _forces(equations: Equations, q: Array) -> tuple[Array, Array]:
    """(r (n, nv), dr/dq (n, nv, nv)) at rest at configurations (n, nq)."""
    numbers, constraints = equations.start[equations.moving :], equations.constraints
    x = np.concatenate([q, np.zeros((len(q), equations.space.nv)), np.tile(numbers, (len(q), 1))], axis=1).T
    formula = unbalanced_forces if constraints is None else accelerations
    r, derivatives = derivatives_of(formula, equations, np.zeros(len(q)), x)
    slope = derivatives[:, :, : equations.space.nv]
    if constraints is None:
        return r, slope
    slope = slope @ np.array([allowed(constraints, each) for each in q]).reshape(slope.shape)
    singular = ~np.isfinite(slope).all(axis=(1, 2))
    r[singular], slope[singular] = 1.0, 0.0  # no equilibrium, and no step from there
    return r, slope


def _newton(equations: Equations, q: Array) -> tuple[Array, Array]:
    """(configurations (n, nq), whether the robot stays at rest there (n,)) from guesses.

    A step is taken where it shortens the next one with the same derivatives, which no scaling of r changes (the natural
    monotonicity test: Deuflhard, Newton Methods for Nonlinear Problems, 2004, section 3.3).
    """
    q, active = q.copy(), np.arange(len(q))
    for _ in range(ROUNDS):
        r, slope = _forces(equations, q[active])
        inverse = np.linalg.pinv(slope, rcond=RANK)
        step = _applied(inverse, r)
        size = np.abs(step).max(axis=1)
        factor, shorter = np.minimum(1.0, STRIDE / np.maximum(size, 1e-300)), np.zeros(len(active), dtype=bool)
        for _ in range(HALVINGS):
            trial, could = _closed(equations, equations.robot.integrate(q[active], factor[:, None] * step))
            trial[~could] = q[active][~could]
            shorter = np.abs(_applied(inverse, _forces(equations, trial)[0])).max(axis=1) < size
            if shorter.all():
                break
            factor[~shorter] *= 0.5
        q[active[shorter]] = trial[shorter]
        active = active[shorter & (size > SMALL)]
        if not len(active):
            break
    return q, _at_rest(*_forces(equations, q))


def _applied(inverse: Array, r: Array) -> Array:
    """The Newton steps (n, nv)."""
    return np.asarray(-np.einsum("nij,nj->ni", inverse, r))


def _at_rest(r: Array, slope: Array) -> Array:
    """True for each of the forces (n, nv) that is 0 but for rounding; slope (n, nv, nv): their derivatives by q."""
    scale = 1.0 + np.abs(slope).max(axis=(1, 2), initial=0.0)
    return np.asarray(np.abs(r).max(axis=1, initial=0.0) <= AT_REST * scale)


def _distinct(equations: Equations, points: Array) -> list[Array]:
    """The points without duplicates, angles within half a turn where the robot stays at rest there too."""
    robot, angles, distinct = equations.robot, equations.space.angles, list[Array]()
    if not len(points):
        return distinct
    turned = points.copy()
    turned[:, angles] -= 2 * np.pi * np.ceil(points[:, angles] / (2 * np.pi) - 0.5 - SAME)
    for stop in equations.switching.stops if equations.switching else ():  # a turn may lead beyond one, or back
        beyond = stop.side * (turned[:, stop.entry] - stop.position) < -SAME
        turned[beyond, stop.entry] += stop.side * 2 * np.pi * (stop.entry in angles)
    points = np.where(_at_rest(*_forces(equations, turned))[:, None], turned, points)
    for point in points:
        if all(np.abs(robot.difference(other, point)).max(initial=0.0) > SAME for other in distinct):
            distinct.append(point)
    return distinct
