"""The recursions over plain arithmetic against Pinocchio, against identities, and compiled against themselves."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import twolink as tl
from tests.dynamics.robots import FOLLOWERS, ODD_JOINTS, balls, spherical, urdf
from twolink.algorithms import recursions
from twolink.algorithms import spatial as sp
from twolink.algorithms.mechanism import Mechanism, mechanism, nominal, parameter_names, single_bodies
from twolink.algorithms.tape import Tape
from twolink.dynamics.certificates import BOUND
from twolink.errors import QueryError

STATES = 8
ROBOTS = dict.fromkeys(("two_link", "arm", "ur5", "panda", "kinova"), "fixed") | {"anymal": "free", "talos": "free"}


def make(name: str) -> pin.Model:
    if name in ROBOTS:
        return tl.load_robot(name, root=ROBOTS[name]).model
    if name == "balls":
        return balls()
    return pin.buildModelFromXML(ODD_JOINTS if name == "odd" else FOLLOWERS, name == "followers")


@pytest.fixture(scope="module", params=[*ROBOTS, "odd", "balls", "followers"])
def model(request: pytest.FixtureRequest) -> pin.Model:
    return make(request.param)


class Case:
    """A model with random states, one a column: q (nq, n), v, a (nv, n), and a wrench on every body."""

    def __init__(self, model: pin.Model, count: int = STATES) -> None:
        rng = np.random.default_rng(3)
        self.model, self.count = model, count
        pin.seed(3)
        bounds = np.full(model.nq, 3.0)
        self.q = np.array([pin.randomConfiguration(model, -bounds, bounds) for _ in range(count)]).T
        self.v, self.a = rng.normal(size=(2, model.nv, count))
        self.f_ext = {j: rng.normal(size=(6, count)) for j in range(1, model.njoints)}

    def forces(self, i: int) -> pin.StdVec_Force:
        forces = pin.StdVec_Force()
        forces.append(pin.Force.Zero())
        forces.extend([pin.Force(f[:, i]) for f in self.f_ext.values()])
        return forces

    def reference(self, algorithm: Any, *arguments: np.ndarray, wrenches: bool = False) -> np.ndarray:
        """Pinocchio's answers, stacked on the last axis.

        A new data for each: with mimic joints, Pinocchio 4.1's crba adds to what the data held before.
        """
        rows = [[*(x[:, i] for x in arguments), *([self.forces(i)] if wrenches else [])] for i in range(self.count)]
        return np.stack([algorithm(self.model, self.model.createData(), *row) for row in rows], axis=-1)

    def dense(self, answer: Any) -> np.ndarray:
        """Nested lists of scalars and rows (n,) as one array (..., n)."""
        if isinstance(answer, (list, tuple)):
            return np.stack([self.dense(x) for x in answer])
        return np.broadcast_to(answer, (self.count,))


@pytest.fixture(scope="module")
def case(model: pin.Model) -> Case:
    return Case(model)


@pytest.fixture(scope="module", params=[mechanism, single_bodies])
def mech(request: pytest.FixtureRequest, model: pin.Model) -> Mechanism:
    return request.param(model)


def close(actual: np.ndarray, expected: np.ndarray, tolerance: float | np.ndarray = 1e-12) -> None:
    """Each state's answer agrees, relative to its largest entry."""
    error = np.abs(actual - expected).reshape(-1, actual.shape[-1]).max(axis=0)
    size = np.abs(expected).reshape(-1, actual.shape[-1]).max(axis=0)
    assert (error <= tolerance * size).all(), (error / size).max()


def test_forward_dynamics(mech: Mechanism, case: Case) -> None:
    tau = case.reference(pin.rnea, case.q, case.v, case.a, wrenches=True)
    condition = np.linalg.cond(np.moveaxis(case.reference(pin.crba, case.q), -1, 0))
    by_matrix = recursions.forward_dynamics_crba(mech, case.q, case.v, tau, case.f_ext, np)
    close(case.dense(by_matrix), case.a, 1e-12 * condition)
    if mech.has_mimic:
        with pytest.raises(QueryError, match="mimic"):
            recursions.forward_dynamics_aba(mech, case.q, case.v, tau, None, np)
        return
    by_bodies = recursions.forward_dynamics_aba(mech, case.q, case.v, tau, case.f_ext, np)
    close(case.dense(by_bodies), case.a, 1e-12 * condition)
    free = recursions.forward_dynamics_aba(mech, case.q, case.v, tau, None, np)
    close(case.dense(free), case.reference(pin.aba, case.q, case.v, tau), 1e-12 * condition)


def test_one_state_of_floats(model: pin.Model) -> None:
    case = Case(model, 1)
    q, v, a = (x[:, 0].tolist() for x in (case.q, case.v, case.a))
    ours = recursions.rnea(mechanism(model), q, v, a, None, np)
    assert_allclose(ours, pin.rnea(model, model.createData(), *map(np.array, (q, v, a))), rtol=1e-11, atol=1e-12)


def with_every_constant(model: pin.Model) -> None:
    """Change a model so that none of its constants is 0."""
    more = pin.Inertia(0.5, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 1.2, 1.4]) - 0.1)
    model.gravity.linear = np.array([1.0, 2.0, -9.0])
    model.armature = model.damping = np.linspace(0.1, 0.4, model.nv)
    for i in range(1, model.njoints):
        model.inertias[i] += more
        model.jointPlacements[i].translation += np.array([0.1, 0.2, 0.3])


@pytest.mark.parametrize("name", ["two_link", "ur5", "odd", "balls"])
def test_every_parameter_moves_the_model_as_the_reference_says(name: str) -> None:
    """All physical constants have values of their own in every state."""
    robot = spherical() if name == "balls" else tl.load_robot(ODD_JOINTS if name == "odd" else name)
    robot = robot.changed(with_every_constant)
    kept = parameter_names(robot.model)
    assert all(nominal(robot.model, each) for each in kept)
    assert robot.compiled(kept).certificate("inverse_dynamics").worst <= BOUND


def test_damping_that_is_asked_for_acts_in_forward_dynamics_too() -> None:
    model = make("odd")
    case, name = Case(model), "j_f.damping"
    assert nominal(model, name) == 0.7
    damped = mechanism(model, {name: nominal(model, name)})
    tau = case.dense(recursions.rnea(damped, case.q, case.v, case.a, None, np))
    for forward in (recursions.forward_dynamics_aba, recursions.forward_dynamics_crba):
        assert_allclose(case.dense(forward(damped, case.q, case.v, tau, None, np)), case.a, rtol=1e-8, atol=1e-9)


def test_a_joint_that_is_not_covered_is_refused() -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelSphericalZYX(), pin.SE3.Identity(), "odd_one")
    with pytest.raises(QueryError, match="odd_one"):
        mechanism(model)


def trace(algorithm: Any, model: pin.Model, mech: Mechanism) -> tuple[int, set[int]]:
    """Operations of algorithm(mech, q, v, tau, None, tape), and the places of the inputs that its answer depends on."""
    tape = Tape()
    inputs = [tape.variables(n) for n in (model.nq, model.nv, model.nv)]
    answer = list(algorithm(mech, *map(list, inputs), None, tape))
    behind = {key for output in answer for key in tape.inputs(output)}
    return sum(tape.count(answer).values()), {k for k, x in enumerate(np.concatenate(inputs)) if x.key in behind}


def test_absent_terms_cost_no_operation() -> None:
    model = make("two_link")
    operations, _ = trace(recursions.forward_dynamics_crba, model, mechanism(model))
    assert operations <= 41
    by_bodies, _ = trace(recursions.forward_dynamics_aba, model, mechanism(model))
    assert by_bodies <= 43
    weightless = mechanism(model, {f"gravity.{c}": 0.0 for c in "xyz"})
    fewer, inputs = trace(recursions.forward_dynamics_crba, model, weightless)
    assert fewer < operations
    assert 0 not in inputs  # a fixed base without gravity: the first angle is nowhere
    assert recursions.gravity_torque(weightless, list(Tape().variables(2)), Tape()) == [0.0, 0.0]


def test_turns_about_coordinate_axes_move_matrices_with_twelve_products() -> None:
    """m n m^T of a rotation m that has a coordinate axis fixed, in all 24 arrangements; a general product takes 54."""
    rng = np.random.default_rng(5)
    n = rng.normal(size=(3, 3))
    exact = [np.array(m) for m in itertools.product(*[[s * e for e in np.eye(3) for s in (1, -1)]] * 3)]
    for place in (m for m in exact if np.linalg.det(m) == 1):
        c, s = np.cos(0.7), np.sin(0.7)
        turn = (place @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])).tolist()
        np.testing.assert_allclose(sp.congruence(turn, n.tolist()), turn @ n @ np.transpose(turn), atol=1e-15)
        tape = Tape()
        symbols = [[tape.variable() if abs(x) not in (0, 1) else x for x in row] for row in turn]
        moved = sp.congruence(symbols, [[tape.variable() for _ in range(3)] for _ in range(3)])
        assert tape.count([x for row in moved for x in row])["*"] <= 12


def test_regrouping_saves_operations() -> None:
    for name in ("arm", "ur5", "anymal"):
        model = make(name)
        for algorithm in (recursions.rnea, recursions.forward_dynamics_crba, recursions.forward_dynamics_aba):
            regrouped, single = (trace(algorithm, model, read(model))[0] for read in (mechanism, single_bodies))
            assert regrouped < single


def test_a_right_angle_of_few_digits_is_the_angle_that_the_file_says() -> None:
    """Its sine rounds to 1, but its cosine is 3e-8, not 0."""
    ends = zip(("base", "a", "b", "c"), "abcd", strict=True)
    chain = urdf(*((*pair, "revolute", "0 0 1", "") for pair in ends))
    model = pin.buildModelFromXML(chain.replace('rpy="0.4 -0.3 0.2"', 'rpy="1.5707963 0 1.5707963"'))
    data, mech = model.createData(), mechanism(model)
    for q in np.random.default_rng(3).uniform(-1, 1, (STATES, model.nq)):
        expected = np.triu(pin.crba(model, data, q))
        expected += np.triu(expected, 1).T
        found = np.array(recursions.composite_bodies(mech, recursions.poses(mech, list(q), np)), dtype=float)
        assert_allclose(found, expected, atol=2e-15 * np.abs(expected).max())
