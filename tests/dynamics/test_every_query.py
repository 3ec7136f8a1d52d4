"""Every query of every engine against the equations of motion written for the test (`tests.dynamics.bodies`).

The models have what algorithms leave out or mix up: armature in every degree of freedom, damping, skew and negative
axes, mimic joints in chains and branches, and every type of joint.
"""

import dataclasses
import functools
import inspect
import itertools
import zlib
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.dynamics.bodies import Bodies, derivative
from tests.dynamics.robots import FOLLOWERS, ODD_JOINTS, random_robot, spherical, urdf
from tests.dynamics.states import states
from tests.refusals import refusal
from twolink.algorithms.functions import function
from twolink.dynamics.queries import ALGORITHMS, QUERIES
from twolink.errors import CertificationError, QueryError
from twolink.native.library import library

Array = np.ndarray
fx = tl.effects

# Revolute and continuous joints along negative axes, of which Pinocchio has types of their own, in branches.
NEGATIVE = urdf(
    ("base", "a", "revolute", "0 -1 0", ""), ("a", "b", "continuous", "0 0 -1", ""),
    ("a", "c", "prismatic", "-1 0 0", ""), ("b", "d", "revolute", "0.6 0.8 0", '<dynamics damping="0.7"/>'),
    ("base", "e", "revolute", "0 0 1", ""),
)  # fmt: skip
BRANCHES = urdf(
    ("base", "a", "revolute", "0 0 1", ""), ("base", "b", "revolute", "0 1 0", '<mimic joint="j_a" multiplier="1.7"/>'),
    ("b", "c", "revolute", "0.6 0 0.8", ""), ("b", "d", "prismatic", "0 -1 0", ""),
)  # fmt: skip
MODELS = ["odd", "negative", "followers", "branches", "balls",
          *(pytest.param(name, marks=pytest.mark.slow) for name in ("kinova", "anymal"))]  # fmt: skip
TEXTS = {"odd": ODD_JOINTS, "negative": NEGATIVE, "followers": FOLLOWERS, "branches": BRANCHES}
ENGINES = ["one state", "batch", *(["compiled"] if library() is not None else [])]


@functools.cache
def robot_of(name: str) -> tl.Robot:
    """A robot with armature, damping and friction in every degree of freedom."""
    if name == "balls":
        robot = spherical()
    elif name in TEXTS:
        robot = tl.load_robot(TEXTS[name], mimic=name in ("followers", "branches"))
    else:
        robot = tl.load_robot(name, root="free" if name == "anymal" else "fixed")

    def geared(model: pin.Model) -> None:
        rng = np.random.default_rng(zlib.crc32(name.encode()))
        model.armature, model.damping = rng.uniform(0.2, 5, model.nv), rng.uniform(0.1, 1, model.nv)
        model.friction = rng.uniform(0.1, 1, model.nv)

    return robot.changed(geared)


def served(engine: str, query: Callable[..., object], q: Array, *others: Array, **options: object) -> list[Array]:
    """The answers to a query for a few states, as one engine gives them: state by state, or in a batch of 72."""
    if engine == "one state":
        rows = [query(*row, engine="pinocchio", **options) for row in zip(q, *others, strict=True)]
        rows = [row if isinstance(row, tuple) else (row,) for row in rows]
        return [np.array(each) for each in zip(*rows, strict=True)]
    many = [np.tile(x, (72 // len(q), 1)) for x in (q, *others)]
    answer = query(*many, engine="compiled" if engine == "compiled" else "pinocchio", **options)
    return [each[: len(q)] for each in (answer if isinstance(answer, tuple) else (answer,))]


def has_engines(method: str) -> bool:
    """Whether a query is also compiled."""
    return "engine" in inspect.signature(getattr(tl.Robot, method)).parameters


def no_engine(query: Callable[..., object]) -> Callable[..., object]:
    """A query that only Pinocchio answers."""
    return lambda *arguments, engine, **options: query(*arguments, **options)  # noqa: ARG005


def check(answer: Array, truth: list[Array], tolerance: float = 1e-12, scale: float = 1e-12) -> None:
    """Each state's answer differs from the truth by no more than the tolerance times the largest entry of its truth."""
    for ours, theirs in zip(answer, truth, strict=True):
        assert ours.shape == np.shape(theirs)
        size = max(scale, float(np.abs(theirs).max(initial=0.0)))
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance * size)


@functools.cache
def truths_of(name: str) -> tuple[Array, Array, Array, list[Bodies]]:
    """Three states (q, v, a) of a robot, and the truth there, which every query and engine is held against."""
    robot = robot_of(name)
    q, v, a = states(robot, 3, seed=5)
    return q, v, a, [Bodies(robot, *state) for state in zip(q, v, strict=True)]


@functools.cache
def torque_derivatives(name: str) -> list[tuple[Array, Array, Array]]:
    """The derivatives (nv, nv) of tau = M a + h by q, v and a, at each of the three states."""
    robot = robot_of(name)
    unit = np.eye(robot.nv)

    def torque(q: Array, v: Array, a: Array) -> Array:
        bodies = Bodies(robot, q, v)
        return bodies.mass_matrix() @ a + bodies.bias()

    def at(q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        by_q = [derivative(lambda s, e=e: torque(pin.integrate(robot.model, q, s * e), v, a)) for e in unit]
        by_v = [0.5 * (torque(q, v + e, a) - torque(q, v - e, a)) for e in unit]  # exact: tau is quadratic in v
        return np.stack(by_q, axis=1), np.stack(by_v, axis=1), Bodies(robot, q, v).mass_matrix()

    return [at(*state) for state in zip(*truths_of(name)[:3], strict=True)]


class Case:
    """A robot, states, the truth there, and an engine."""

    def __init__(self, name: str, engine: str) -> None:
        self.name, self.robot, self.engine = name, robot_of(name), engine
        self.q, self.v, self.a, self.truths = truths_of(name)
        self.rows = list(zip(self.truths, self.q, self.v, self.a, strict=True))

    def asked(self, query: str, *others: Array, **options: object) -> list[Array]:
        method = getattr(self.robot, query)
        method = method if has_engines(query) else no_engine(method)
        return served(self.engine, method, self.q, *others, **options)

    def wrenches(self) -> list[tuple[dict[str, object], list[Array]]]:
        """f_ext with a wrench on the last frame, and J^T w of each state: in the frame's axes, and in the world's."""
        tip, wrench = self.robot.frame_names[-1], np.array([1.0, -2.0, 3.0, 0.5, -4.0, 2.0])
        frames = [truth.frame(tip) for truth in self.truths]
        own = [jacobian.T @ wrench for _, _, jacobian in frames]
        along = [jacobian.T @ np.kron(np.eye(2), turn.T) @ wrench for turn, _, jacobian in frames]
        return [
            ({tip: tl.Wrench(wrench, "frame")}, own),
            ({tip: wrench}, own),
            ({tip: tl.Wrench(wrench, "world")}, along),
        ]


def inverse_dynamics(case: Case) -> None:
    expected = [t.mass_matrix() @ a + t.bias() for t, _, _, a in case.rows]
    check(case.asked("inverse_dynamics", case.v, case.a)[0], expected)
    for given, pushes in case.wrenches():
        pushed = [tau - push for tau, push in zip(expected, pushes, strict=True)]
        check(case.asked("inverse_dynamics", case.v, case.a, f_ext=given)[0], pushed)
    if case.robot.has_mimic:
        return
    lossy, speeds = case.robot.model, np.where(np.arange(case.robot.nv) % 3 == 1, 0.0, case.v)  # some joints rest
    lost = lossy.damping * speeds + np.where(speeds > 0, lossy.friction, np.where(speeds < 0, -lossy.friction, 0.0))
    without = case.asked("inverse_dynamics", speeds, case.a)[0]
    check(case.asked("inverse_dynamics", speeds, case.a, losses=True)[0], list(without + lost))


def forward_dynamics(case: Case) -> None:
    """M a + h = tau + J^T w, also of the second method and with mimic joints."""
    methods = ("auto", *(() if case.robot.has_mimic else ("aba",)), *(() if case.engine == "compiled" else ("crba",)))
    for method, (given, pushes) in itertools.product(methods, [(None, 0.0 * case.v), *case.wrenches()]):
        found = case.asked("forward_dynamics", case.v, case.a, method=method, f_ext=given)[0]
        for a, push, (truth, _, _, tau) in zip(found, pushes, case.rows, strict=True):
            terms = np.abs(truth.mass_matrix()) @ np.abs(a) + np.abs(truth.bias()) + np.abs(tau) + np.abs(push)
            assert (np.abs(truth.mass_matrix() @ a + truth.bias() - tau - push) <= 1e-11 * terms.max()).all()


def mass_matrix(case: Case) -> None:
    """M, and symmetric to the bit."""
    (found,) = case.asked("mass_matrix")
    check(found, [t.mass_matrix() for t in case.truths])
    assert np.array_equal(found, np.swapaxes(found, -1, -2))


def coriolis(case: Case) -> None:
    """C v = h - g, and dM/dt = C + C^T along v."""
    for C, (truth, q, v, _) in zip(case.asked("coriolis", case.v)[0], case.rows, strict=True):
        check([C @ v], [truth.bias() - truth.gravity_torque()], scale=np.abs(truth.bias()).max())
        moved = derivative(
            lambda s, q=q, v=v: Bodies(case.robot, pin.integrate(case.robot.model, q, s * v), v).mass_matrix()
        )
        check([C + C.T], [moved], 1e-7)


def energy(case: Case) -> None:
    kinetic, potential = case.asked("energy", case.v)
    truth = np.array([t.energy() for t in case.truths])
    np.testing.assert_allclose(kinetic, truth[:, 0], rtol=1e-13)
    np.testing.assert_allclose(potential, truth[:, 1], rtol=0, atol=1e-12 * np.abs(truth).max())


def frame_pose(case: Case) -> None:
    for name in case.robot.frame_names:
        turns, places = case.asked("frame_pose", frame=name)
        check(turns, [t.frame(name)[0] for t in case.truths])
        check(places, [t.frame(name)[1] for t in case.truths])


def jacobians(case: Case, name: str, axes: str) -> list[Array]:
    """The truth for a frame in the chosen axes."""
    found = [t.frame(name) for t in case.truths]
    return [j if axes == "local" else np.kron(np.eye(2), turn) @ j for turn, _, j in found]


def frame_jacobian(case: Case) -> None:
    for name in case.robot.frame_names[1:]:
        for axes in ("local", "aligned"):
            check(case.asked("frame_jacobian", frame=name, axes=axes)[0], jacobians(case, name, axes))


def frame_velocity(case: Case) -> None:
    for name in case.robot.frame_names[1:]:
        for axes in ("local", "aligned"):
            expected = [j @ v for j, v in zip(jacobians(case, name, axes), case.v, strict=True)]
            check(case.asked("frame_velocity", case.v, frame=name, axes=axes)[0], expected)


def inverse_dynamics_derivatives(case: Case) -> None:
    found = case.asked("inverse_dynamics_derivatives", case.v, case.a)
    expected = torque_derivatives(case.name)
    for ours, theirs, tolerance in zip(found, zip(*expected, strict=True), (1e-8, 1e-10, 1e-12), strict=True):
        check(ours, list(theirs), tolerance)


def forward_dynamics_derivatives(case: Case) -> None:
    """M da/dx = -dtau/dx at the acceleration, which tau = M a + h gives, and M da/dtau = 1."""
    tau = np.array([truth.mass_matrix() @ a + truth.bias() for truth, _, _, a in case.rows])
    found = case.asked("forward_dynamics_derivatives", case.v, tau)
    for (of_q, of_v, M), by_q, by_v, by_tau in zip(torque_derivatives(case.name), *found, strict=True):
        check([M @ by_q, M @ by_v, M @ by_tau], [-of_q, -of_v, np.eye(len(M))], 1e-8)


TRUTHS: dict[str, Callable[[Case], None]] = {
    "forward-dynamics": forward_dynamics,
    "inverse-dynamics": inverse_dynamics,
    "mass-matrix": mass_matrix,
    "bias": lambda case: check(case.asked("bias", case.v)[0], [t.bias() for t in case.truths]),
    "coriolis": coriolis,
    "gravity-torque": lambda case: check(case.asked("gravity_torque")[0], [t.gravity_torque() for t in case.truths]),
    "energy": energy,
    "centre-of-mass": lambda case: check(case.asked("centre_of_mass")[0], [t.centre_of_mass() for t in case.truths]),
    "momentum": lambda case: check(case.asked("momentum", case.v)[0], [t.momentum() for t in case.truths]),
    "frame-pose": frame_pose,
    "frame-velocity": frame_velocity,
    "frame-jacobian": frame_jacobian,
    "forward-dynamics-derivatives": forward_dynamics_derivatives,
    "inverse-dynamics-derivatives": inverse_dynamics_derivatives,
}


def test_every_query_has_a_truth() -> None:
    assert set(TRUTHS) == set(QUERIES)


ASKED = [(query, engine) for query in TRUTHS for engine in ENGINES
         if engine != "compiled" or has_engines(QUERIES[query].method)]  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(("query", "engine"), ASKED)
def test_every_engine_answers_the_equations_of_motion(query: str, name: str, engine: str) -> None:
    case = Case(name, engine)
    algorithm = ALGORITHMS.get(QUERIES[query].method)
    if case.robot.has_mimic and algorithm is not None and isinstance(algorithm.mimic, str):
        with refusal(QueryError, "mimic joints", code="mimic-joints"):
            TRUTHS[query](case)
        return
    TRUTHS[query](case)


@pytest.mark.parametrize("name", MODELS)
def test_the_regressor_gives_the_equations_of_motion(name: str) -> None:
    """Y pi = M a + h; armature is a parameter of joints with one degree of freedom only."""
    case = Case(name, "one state")
    robot, single = case.robot, [j.v.start for j in case.robot.joints if j.v.stop - j.v.start == 1]
    others = np.where(np.isin(np.arange(robot.nv), single), 0.0, np.array(robot.model.armature))
    expected = [t.mass_matrix() @ a + t.bias() - others * a for t, _, _, a in case.rows]
    check(robot.regressor(case.q, case.v, case.a) @ robot.parameter_values, expected)


@pytest.mark.skipif(library() is None, reason="without the native library nothing is compiled")
@pytest.mark.parametrize("name", MODELS)
def test_certificates_compare_both_engines(name: str) -> None:
    """What Pinocchio answers is held against the reference, too, for every compiled function."""
    robot = robot_of(name)
    tip = robot.frame_names[-1]
    for key, algorithm in ALGORITHMS.items():
        of = f"{key}:{tip}" if key.startswith("frame_") else key
        try:
            function(robot.model, of)
        except QueryError:  # it is not compiled
            continue
        if robot.has_mimic and isinstance(algorithm.mimic, str):
            continue
        certificate = robot.compiled().certificate(of)
        assert max(certificate.worst, certificate.pinocchio) <= certificate.bound


@pytest.mark.skipif(library() is None, reason="without the native library nothing is compiled")
def test_a_wrong_answer_of_pinocchio_is_not_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its kinetic energy leaves out the armature of revolute joints with skew axes."""

    def without_armature(model: pin.Model, data: pin.Data, q: Array, v: Array) -> Array:
        return np.array([pin.computeKineticEnergy(model, data, q, v), pin.computePotentialEnergy(model, data, q)])

    algorithm = dataclasses.replace(ALGORITHMS["energy"], one=without_armature)
    monkeypatch.setitem(ALGORITHMS, "energy", algorithm)
    robot = robot_of("negative").changed(lambda model: setattr(model, "armature", 2 * model.armature))
    with pytest.raises(CertificationError, match="Pinocchio's answer differs from the reference"):
        robot.compiled().certificate("energy")


def energy_error(seed: int) -> float:
    """The largest relative error of the energies of a random robot, over states and engines."""
    rng, worst = np.random.default_rng(seed), 0.0
    robot = random_robot(rng)
    q, v, _ = states(robot, 4, seed)
    truth = np.array([Bodies(robot, *state).energy() for state in zip(q, v, strict=True)])
    heights = robot.mass * np.linalg.norm(robot.gravity) * np.abs(robot.centre_of_mass(q)).max(axis=1)
    for engine in ENGINES:
        kinetic, potential = served(engine, robot.energy, q, v)
        worst = max(worst, float(np.abs(kinetic / truth[:, 0] - 1).max()))
        worst = max(worst, float((np.abs(potential - truth[:, 1]) / heights).max()))
    return worst


@pytest.mark.some(1)
@pytest.mark.parametrize("group", range(20))
def test_energies_of_random_robots_with_rotors(group: int) -> None:
    """200 robots, all engines."""
    assert max(energy_error(seed) for seed in range(10 * group, 10 * group + 10)) < 1e-12
