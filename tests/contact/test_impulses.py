"""The contact problem: each way to its solution, what a solution obeys, and steps without one."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
import scipy.sparse as sparse

import twolink as tl
from tests.effects.bodies import above, ball, free_bodies, grounded, planar, spheres, stepped
from tests.near import assert_near
from tests.refusals import refusal
from twolink.contact import impulses, step_law, stepping
from twolink.contact.impulses import ContactProblem, Impulses, accelerated, newton, solve_impulses
from twolink.geometry.gaps import axes_of

E = tl.effects


def random_problem(seed: int, redundant: bool = False) -> ContactProblem:
    """Six contacts of 20 degrees of freedom, or of 6, which do not determine their forces."""
    random = np.random.default_rng(seed)
    rows = random.standard_normal((18, 6 if redundant else 20))
    b = rows @ random.standard_normal(rows.shape[1]) if redundant else random.standard_normal(18)
    return ContactProblem(rows @ rows.T, b.reshape(6, 3), np.full(6, 0.4))


def require_laws(problem: ContactProblem, found: Impulses, small: float) -> None:
    """Contact, friction's cone, and friction against the slip."""
    p, u = found.p, problem.velocities(found.p)
    assert p[:, 2].min() >= -small
    assert u[:, 2].min() >= -small
    assert_near(p[:, 2] * u[:, 2], 0.0, small)
    slip, size = np.hypot(*u[:, :2].T), np.hypot(*p[:, :2].T)
    assert (size - problem.mu * p[:, 2]).max() < small
    assert_near((p[:, :2] * u[:, :2]).sum(axis=1) + problem.mu * p[:, 2] * slip, 0.0, small)


def admm(problem: ContactProblem) -> np.ndarray:
    """Impulses by Pinocchio's ADMM solver, which shares no code with ours."""
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for mu in problem.mu.tolist():
        contact = pin.PointContactConstraintModel(pin.buildSampleModelManipulator(), 1, pin.SE3.Identity())
        contact.setFriction(mu)
        models.append(pin.ConstraintModel(contact))
        datas.append(pin.ConstraintData(contact.createData()))
    settings, result = pin.ADMMSolverSettings(), pin.ADMMSolverResult()
    settings.max_iterations = 2_000
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = 1e-10
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = 1e-12
    result.resize(problem.b.size)
    pin.ADMMConstraintSolver(problem.b.size).solve(
        pin.DelassusOperatorDense(problem.matrix), problem.b.ravel(), models, datas, settings, result
    )
    return np.array(result.retrieveConstraintImpulses()).reshape(-1, 3)


@pytest.mark.parametrize("redundant", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_impulses_obey_the_laws(seed: int, redundant: bool) -> None:
    problem = random_problem(seed, redundant)
    found = solve_impulses(problem, np.zeros((6, 3)))
    assert found.solved
    require_laws(problem, found, 1e-9)


@pytest.mark.parametrize("solver", [lambda problem: accelerated(problem, np.zeros((6, 3)), 300), admm])
def test_other_ways_come_near_enough_for_newton(solver: Callable[[ContactProblem], np.ndarray]) -> None:
    for seed in range(3):
        problem = random_problem(seed)
        near = solver(problem)
        require_laws(problem, problem.answer(near, "near"), 1e-4)
        exact = problem.answer(newton(problem, near), "exact")
        assert exact.solved
        assert_near(exact.p, near, 1e-3)


def test_sparse_problems_have_the_same_solution() -> None:
    full = random_problem(1)
    thin = ContactProblem(sparse.csr_array(full.matrix), full.b, full.mu)
    want = solve_impulses(full, np.zeros((6, 3))).p
    assert_near(solve_impulses(thin, np.zeros((6, 3))).p, want, 1e-9)
    assert_near(admm(full), want, 1e-4)


def test_a_step_that_misses_the_laws_is_halved_and_then_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(problem: ContactProblem, guess: np.ndarray) -> Impulses:
        return dataclasses.replace(solve_impulses(problem, guess), residual=1.0)

    monkeypatch.setattr(step_law, "solve_impulses", never)
    monkeypatch.setattr(stepping, "compiled", lambda *_: None)
    scene = grounded(ball(), above(0.11), shapes=spheres("ball"))
    with refusal(tl.errors.AccuracyError, code="contact-not-solved", match="no impulses obey the laws"):
        stepped(scene, 0.1, 0.01)


@pytest.mark.parametrize("speed", [90.0, 120.0])
def test_fast_bodies_do_not_pass_through_each_other(speed: float) -> None:
    """At the middle of its first step a ball would be inside the other one, or out of it on the other side."""
    shapes = spheres(*"ab")
    q = [0, 0, 0, 0, 0, 0, 1, 1.0, 0, 0, 0, 0, 0, 1]
    scene = tl.Scene(free_bodies("a", "b"), q, [speed, *[0] * 11], [E.Contact(("self",), shapes=shapes)])
    run = stepped(scene, 0.1, 0.02, samples=10)
    assert run.contact_record["halved"] > 0
    assert_near(run.q[-1, 7] - run.q[-1, 0], 0.2, 1e-9)
    assert run.v[-1, [0, 6]] == pytest.approx([speed / 2, speed / 2])


def falling_pile(seed: int, side: int, friction: float) -> ContactProblem:
    """Spheres of 1 m that lie loosely on a grid, side by side, and fall the faster the lower they are."""
    random = np.random.default_rng(seed)
    places = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    places = places + random.uniform(-0.15, 0.15, places.shape)
    a, b = np.triu_indices(len(places), 1)
    apart = places[a] - places[b]
    near = np.linalg.norm(apart, axis=1) < 1.25
    a, b, normals = a[near], b[near], apart[near] / np.linalg.norm(apart[near], axis=1)[:, None]
    axes, rows = axes_of(normals), np.zeros((len(a), 3, len(places), 6))
    for body, sign in ((a, 1.0), (b, -1.0)):
        turning = np.cross(-0.5 * sign * normals[:, None], axes)
        rows[np.arange(len(a)), :, body] = sign * np.concatenate([axes, turning], axis=2)
    flat = sparse.csr_array(rows.reshape(3 * len(a), -1))
    velocity = 0.3 * random.standard_normal(flat.shape[1])
    velocity[2::6] -= places[:, 2]
    inverse = sparse.diags_array(np.tile([1.0, 1.0, 1.0, 10.0, 10.0, 10.0], len(places)))
    b = (flat @ velocity).reshape(-1, 3)
    return ContactProblem(flat @ inverse @ flat.T, b, np.full(len(a), friction))


@pytest.mark.parametrize(("seed", "side", "friction"), [(3, 5, 0.3), (4, 5, 1.0), (1, 7, 0.3)])
def test_piles_in_which_newtons_method_goes_round_in_circles_are_solved(seed: int, side: int, friction: float) -> None:
    problem = falling_pile(seed, side, friction)
    found = solve_impulses(problem, np.zeros_like(problem.b))
    assert len(problem.b) > 300
    assert found.solved
    require_laws(problem, found, 1e-9)


def test_piles_take_few_of_newtons_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """With exact proximal points, each attempt from the guess, these three take 1292."""
    steps: list[int] = []
    one = impulses._newton_step

    def counted(problem: ContactProblem, f: np.ndarray, z: np.ndarray, damping: float) -> np.ndarray:
        steps.append(1)
        return one(problem, f, z, damping)

    monkeypatch.setattr(impulses, "_newton_step", counted)
    for seed in range(3):
        problem = falling_pile(seed, 5, 1.0)
        assert solve_impulses(problem, np.zeros_like(problem.b)).solved
    assert len(steps) < 600


def test_bodies_bounce_by_no_more_than_creates_no_energy() -> None:
    """A rod that Newton's law of impact with friction would give more energy, as Kane and Levinson found."""
    half, angle, mu, e, v = 0.5, 0.8, 0.6, 0.9, np.array([0.9, -1.5, 8.6])
    rows = np.array([[1.0, 0.0, half * math.sin(angle)], [0.0, 1.0, -half * math.cos(angle)]])  # of its lower end
    inverse = np.diag([1.0, 1.0, 10.0])
    g, before = rows @ inverse @ rows.T, rows @ v
    p = np.linalg.solve(g, [-before[0], -(1.0 + e) * before[1]])  # it sticks
    assert abs(p[0]) < mu * p[1]
    created = p @ (before + 0.5 * g @ p)
    ends = {"body": (E.Sphere(0.0, (half, 0.0, 0.0)), E.Sphere(0.0, (-half, 0.0, 0.0)))}
    scene = tl.Scene(planar(), [0, half * math.sin(angle) + 1e-9, angle], v,
                     [E.Contact(("ground",), mu, restitution=e, shapes=ends)])  # fmt: skip
    run = stepped(scene, 0.02, 1e-4, samples=200)
    assert run.contact_record["softened"] == 1
    assert created > 0.02 * run.energy[0]
    assert_near(run.energy / run.energy[0], 1.0, 1e-3)
    assert run.v[-1, 1] > 0.0


def test_balls_that_lose_nothing_keep_their_whole_restitution() -> None:
    """Where in a step they meet changes nothing: z = v t - g t^2 / 2 from bounce to bounce."""
    contact = E.Contact(("ground",), restitution=1.0, shapes=spheres("ball"))
    scene = tl.Scene(ball(), above(1.1), effects=[E.Gravity((0.0, 0.0, -10.0)), contact])
    for step in (1e-2, 7e-3, 3.3e-3):
        run = stepped(scene, 2.0, step)
        assert run.contact_record["softened"] == 0
        rise = math.sqrt(2.0 / 10.0)
        t = (run.t + rise) % (2.0 * rise) - rise
        assert_near(run.q[:, 2] - 1.1 + 5.0 * t**2, 0.0, 1e-11)


@pytest.mark.parametrize("full", [True, False])
def test_each_island_is_solved_alone(full: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = [random_problem(seed, redundant=seed > 0) for seed in range(3)]
    order = np.random.default_rng(0).permutation(18)
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    matrix = sparse.block_diag([part.matrix for part in parts], format="csr")[rows][:, rows]
    b = np.concatenate([part.b for part in parts])[order]
    problem = ContactProblem(matrix.toarray() if full else matrix, b, np.full(18, 0.4))
    islands = sorted(sorted(order[island].tolist()) for island in problem.islands())
    assert islands == np.arange(18).reshape(3, 6).tolist()
    seen: list[int] = []
    monkeypatch.setattr(impulses, "newton", lambda one, guess: (seen.append(len(guess)), newton(one, guess))[1])
    monkeypatch.setattr(impulses, "proximal", lambda _, guess: guess)
    found = solve_impulses(problem, np.zeros((18, 3)))
    assert seen == [6, 6, 6]
    assert found.solved
    require_laws(problem, found, 1e-9)
