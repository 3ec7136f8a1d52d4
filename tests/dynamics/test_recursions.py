"""The recursions over plain arithmetic against Pinocchio, against identities, and compiled against themselves."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import twolink
from twolink.algorithms import recursions
from twolink.algorithms import recursions as articulated
from twolink.algorithms import spatial as sp
from twolink.algorithms.mechanism import Mechanism, mechanism, nominal, parameter_names, single_bodies
from twolink.algorithms.spatial import Pose
from twolink.algorithms.tape import Tape
from twolink.errors import QueryError
from twolink.native.machine import Program, assembled

STATES = 8
ROBOTS = dict.fromkeys(("two_link", "arm", "ur5", "panda", "kinova"), "fixed") | {"anymal": "free", "talos": "free"}

_LINK = """<link name="{}"><inertial><origin xyz="0.1 -0.2 0.3" rpy="0.3 0.1 -0.5"/><mass value="{}"/>
<inertia ixx="0.2" ixy="0.01" ixz="-0.02" iyy="0.25" iyz="0.03" izz="0.3"/></inertial></link>"""
_JOINT = """<joint name="j_{1}" type="{2}"><parent link="{0}"/><child link="{1}"/>
<origin xyz="0.3 0.1 -0.2" rpy="0.4 -0.3 0.2"/><axis xyz="{3}"/>
<limit lower="-2" upper="2" effort="9" velocity="9"/>{4}</joint>"""


def urdf(*joints: tuple[str, str, str, str, str]) -> str:
    """URDF text; a joint is (parent link, child link, type, axis, further elements)."""
    links = "".join(_LINK.format(child, n + 1.5) for n, (_, child, *_) in enumerate(joints))
    return f'<robot name="made"><link name="base"/>{links}{"".join(_JOINT.format(*j) for j in joints)}</robot>'


ODD_JOINTS = urdf(
    ("base", "a", "planar", "0 0 1", ""),
    ("a", "b", "prismatic", "0.6 0 0.8", ""),
    ("b", "c", "floating", "0 0 1", ""),
    ("c", "d", "continuous", "0.6 -0.8 0", ""),
    ("c", "e", "prismatic", "0 -1 0", ""),
    ("e", "f", "revolute", "1 2 3", '<dynamics damping="0.7" friction="0"/>'),
    ("a", "g", "continuous", "0 0 1", ""),
)
FOLLOWERS = urdf(
    ("base", "a", "revolute", "0 0.6 0.8", ""),
    ("a", "b", "revolute", "1 0 0", '<mimic joint="j_a" multiplier="-2" offset="0.3"/>'),
    ("b", "c", "prismatic", "0 1 0", ""),
    ("a", "d", "prismatic", "0.6 0 -0.8", '<mimic joint="j_c" multiplier="0.5"/>'),
    ("d", "e", "continuous", "0 0 1", ""),
    ("e", "f", "continuous", "0 1 0", '<mimic joint="j_e" multiplier="3" offset="-0.2"/>'),
)


def balls() -> pin.Model:
    """A tree with two ball joints, added depth first."""
    model = pin.Model()
    place = pin.SE3(pin.rpy.rpyToMatrix(0.2, 0.5, -0.4), np.array([0.2, -0.3, 0.5]))
    kinds = (pin.JointModelSpherical(), pin.JointModelRY(), pin.JointModelSpherical(), pin.JointModelPX())
    for n, (parent, kind) in enumerate(zip((0, 1, 2, 1), kinds, strict=True)):
        added = model.addJoint(parent, kind, place, f"j{n}")
        body = pin.Inertia(1.0 + n, np.array([0.1, 0.2, -0.1 * n]), np.diag([0.3, 0.4, 0.35]))
        model.appendBodyToJoint(added, body, pin.SE3.Identity())
    model.armature = np.linspace(0.1, 0.4, model.nv)
    return model


def make(name: str) -> pin.Model:
    if name in ROBOTS:
        return twolink.load_robot(name, root=ROBOTS[name]).model
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
        return np.stack(
            [
                algorithm(
                    self.model,
                    self.model.createData(),
                    *(x[:, i] for x in arguments),
                    *([self.forces(i)] if wrenches else []),
                )
                for i in range(self.count)
            ],
            axis=-1,
        )

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


def test_inverse_dynamics(mech: Mechanism, case: Case) -> None:
    ours = recursions.rnea(mech, case.q, case.v, case.a, None, np)
    close(case.dense(ours), case.reference(pin.rnea, case.q, case.v, case.a))
    pushed = recursions.rnea(mech, case.q, case.v, case.a, case.f_ext, np)
    close(case.dense(pushed), case.reference(pin.rnea, case.q, case.v, case.a, wrenches=True))


def test_bias_and_gravity(mech: Mechanism, case: Case) -> None:
    still = np.zeros_like(case.v)
    bias, gravity = recursions.bias(mech, case.q, case.v, xp=np), recursions.gravity_torque(mech, case.q, np)
    close(case.dense(bias), case.reference(pin.rnea, case.q, case.v, still))
    weight = case.reference(pin.rnea, case.q, still, still)
    assert_allclose(case.dense(gravity), weight, rtol=0, atol=1e-12 * max(1.0, np.abs(weight).max()))


def test_mass_matrix(mech: Mechanism, case: Case) -> None:
    close(case.dense(recursions.crba(mech, case.q, np)), case.reference(pin.crba, case.q))


def test_forward_dynamics(mech: Mechanism, case: Case) -> None:
    tau = case.reference(pin.rnea, case.q, case.v, case.a, wrenches=True)
    condition = np.linalg.cond(np.moveaxis(case.reference(pin.crba, case.q), -1, 0))
    by_matrix = recursions.forward_dynamics_crba(mech, case.q, case.v, tau, case.f_ext, np)
    close(case.dense(by_matrix), case.a, 1e-12 * condition)
    if mech.has_mimic:
        with pytest.raises(QueryError, match="mimic"):
            articulated.forward_dynamics_aba(mech, case.q, case.v, tau, None, np)
        return
    by_bodies = articulated.forward_dynamics_aba(mech, case.q, case.v, tau, case.f_ext, np)
    close(case.dense(by_bodies), case.a, 1e-12 * condition)
    free = articulated.forward_dynamics_aba(mech, case.q, case.v, tau, None, np)
    close(case.dense(free), case.reference(pin.aba, case.q, case.v, tau), 1e-12 * condition)


def test_energy(mech: Mechanism, case: Case) -> None:
    kinetic, potential = recursions.energy(mech, case.q, case.v, np)
    if mech.has_mimic:  # Pinocchio's energies refuse them: the potential from where it puts the bodies
        model = case.model
        heights = []
        for q in case.q.T:
            data = model.createData()
            pin.forwardKinematics(model, data, q)
            bodies = [(b, data.oMi[j]) for j, b in enumerate(model.inertias) if j]
            heights.append(sum(b.mass * place.act(b.lever) for b, place in bodies))
        assert_allclose(case.dense(potential), -np.array(heights) @ model.gravity.linear, rtol=1e-12, atol=1e-12)
        return
    assert_allclose(kinetic, case.reference(pin.computeKineticEnergy, case.q, case.v), rtol=1e-12)
    expected = case.reference(pin.computePotentialEnergy, case.q)
    assert_allclose(case.dense(potential), expected, rtol=0, atol=1e-12 * max(1.0, np.abs(expected).max()))


def test_kinetic_energy_is_half_v_m_v(mech: Mechanism, case: Case) -> None:
    matrix = case.dense(recursions.crba(mech, case.q, np))
    kinetic, _ = recursions.energy(mech, case.q, case.v, np)
    assert_allclose(kinetic, np.einsum("in,ijn,jn->n", case.v, matrix, case.v) / 2, rtol=1e-12)


def test_power_balance(mech: Mechanism, case: Case) -> None:
    """d/dt (kinetic + potential) = v . tau, by central differences along the motion."""
    step, energies = 1e-5, []
    tau = case.dense(recursions.rnea(mech, case.q, case.v, case.a, None, np))
    for t in (-step, step):
        tangent = (case.v + case.a * t / 2) * t
        columns = zip(case.q.T, tangent.T, strict=True)
        q = np.stack([pin.integrate(case.model, x, d) for x, d in columns], axis=-1)
        energies.append(sum(recursions.energy(mech, q, case.v + case.a * t, np)))
    power = np.einsum("in,in->n", case.v, tau)
    scale = np.abs(case.v * tau).sum(axis=0).max() + np.abs(energies[0]).max()
    assert_allclose((energies[1] - energies[0]) / (2 * step), power, rtol=0, atol=1e-7 * scale)


def test_frames(mech: Mechanism, case: Case) -> None:
    place = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.7, -0.3), np.array([0.3, -0.1, 0.2]))
    body, model = case.model.njoints - 1, case.model.copy()
    frame = model.addFrame(pin.Frame("probe", body, 0, place, pin.FrameType.OP_FRAME))
    at = Pose((tuple(map(tuple, place.rotation.tolist())),), tuple(place.translation.tolist()))
    rotation, position = recursions.frame_placement(mech, case.q, body, at, np)
    for i in range(case.count):
        data = model.createData()
        pin.framesForwardKinematics(model, data, case.q[:, i])
        assert_allclose(case.dense(rotation)[..., i], data.oMf[frame].rotation, atol=1e-13)
        assert_allclose(case.dense(position)[..., i], data.oMf[frame].translation, atol=1e-12)
        for axes, theirs in (("local", pin.LOCAL), ("aligned", pin.LOCAL_WORLD_ALIGNED)):
            ours = case.dense(recursions.frame_jacobian(mech, case.q, body, at, np, axes))[..., i]
            pin.forwardKinematics(model, data, case.q[:, i], case.v[:, i])
            expected = pin.getFrameVelocity(model, data, frame, theirs).vector
            assert_allclose(ours @ case.v[:, i], expected, atol=1e-11)


def test_one_state_of_floats(model: pin.Model) -> None:
    case = Case(model, 1)
    q, v, a = (x[:, 0].tolist() for x in (case.q, case.v, case.a))
    ours = recursions.rnea(mechanism(model), q, v, a, None, np)
    assert_allclose(ours, pin.rnea(model, model.createData(), *map(np.array, (q, v, a))), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("name", ["two_link", "ur5", "odd", "balls"])
def test_every_parameter_moves_the_model_as_pinocchio_does(name: str) -> None:
    """All physical constants replaced by arrays, one robot a column, against Pinocchio models built for each."""
    model, rng = make(name), np.random.default_rng(5)
    case = Case(model)
    factors = {p: rng.uniform(0.9, 1.1, case.count) for p in parameter_names(model) if not p.endswith("damping")}
    values = {p: nominal(model, p) * f for p, f in factors.items()}
    ours = case.dense(recursions.rnea(mechanism(model, values), case.q, case.v, case.a, None, np))
    links = {f.parentJoint: f.name for f in reversed(model.frames) if f.type == pin.FrameType.BODY}
    bodies = [links.get(j, model.names[j]) for j in range(model.njoints)]
    for i in range(case.count):
        other = model.copy()
        other.gravity.linear = np.array([values[f"gravity.{c}"][i] for c in "xyz"])
        for j in range(1, model.njoints):
            com = np.array([values[f"{bodies[j]}.com.{c}"][i] for c in "xyz"])
            names = [[f"{bodies[j]}.inertia.{min(r, c)}{max(r, c)}" for c in "xyz"] for r in "xyz"]
            moments = np.array([[values[name][i] for name in row] for row in names])
            other.inertias[j] = pin.Inertia(values[f"{bodies[j]}.mass"][i], com, moments)
            origin = np.array([values[f"{model.names[j]}.origin.{c}"][i] for c in "xyz"])
            other.jointPlacements[j].translation = origin
            if model.joints[j].nv == 1:
                other.armature[model.joints[j].idx_v] = values[f"{model.names[j]}.armature"][i]
        expected = pin.rnea(other, other.createData(), case.q[:, i], case.v[:, i], case.a[:, i])
        assert_allclose(ours[:, i], expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_damping_acts_only_where_asked() -> None:
    model = make("odd")
    case, name = Case(model), "j_f.damping"
    assert nominal(model, name) == 0.7
    plain = case.dense(recursions.rnea(mechanism(model), case.q, case.v, case.a, None, np))
    damped = mechanism(model, {name: nominal(model, name)})
    tau = case.dense(recursions.rnea(damped, case.q, case.v, case.a, None, np))
    k = model.joints[model.getJointId("j_f")].idx_v
    expected = np.zeros_like(plain)
    expected[k] = 0.7 * case.v[k]
    assert_allclose(tau - plain, expected, atol=1e-11)
    for forward in (articulated.forward_dynamics_aba, recursions.forward_dynamics_crba):
        assert_allclose(case.dense(forward(damped, case.q, case.v, tau, None, np)), case.a, rtol=1e-8, atol=1e-9)


def test_unknown_parameter_names_the_nearest() -> None:
    with pytest.raises(QueryError, match=r"did you mean 'forearm\.mass'"):
        mechanism(make("two_link"), {"forearm.mas": 1.0})
    with pytest.raises(QueryError, match="there is no parameter"):
        nominal(make("two_link"), "nothing")


def test_a_joint_that_is_not_covered_is_refused() -> None:
    model = pin.Model()
    model.addJoint(0, pin.JointModelSphericalZYX(), pin.SE3.Identity(), "odd_one")
    with pytest.raises(QueryError, match="odd_one"):
        mechanism(model)


class Traced:
    """A scalar that records its operations; equal ones are one. A sign is no operation: it goes into a sum."""

    def __init__(self, book: dict[Any, Traced], key: tuple[Any, ...], parts: tuple[Any, ...] = ()) -> None:
        self.book, self.key, self.parts = book, key, parts

    def _made(self, name: str, *parts: Any) -> Traced:
        key = (name, *(id(p) if isinstance(p, Traced) else p for p in parts))
        if key not in self.book:
            self.book[key] = Traced(self.book, key, parts)
        return self.book[key]

    def __add__(self, other: Any) -> Traced:
        return self._made("+", self, other)

    def __sub__(self, other: Any) -> Traced:
        return self._made("-", self, other)

    def __rsub__(self, other: Any) -> Traced:
        return self._made("-", other, self)

    def __mul__(self, other: Any) -> Traced:
        return self._made("*", self, other)

    def __truediv__(self, other: Any) -> Traced:
        return self._made("/", self, other)

    def __rtruediv__(self, other: Any) -> Traced:
        return self._made("/", other, self)

    def __neg__(self) -> Traced:
        return self._made("neg", self)

    def sin(self) -> Traced:
        return self._made("sin", self)

    def cos(self) -> Traced:
        return self._made("cos", self)

    __radd__, __rmul__ = __add__, __mul__


def trace(algorithm: Any, model: pin.Model, mech: Mechanism, inputs: int) -> tuple[int, set[str]]:
    """Operations of algorithm(mech, q, ...), and the inputs its answer depends on."""
    book: dict[Any, Traced] = {}
    sizes = {"q": model.nq, "v": model.nv, "tau": model.nv}
    symbols = [[Traced(book, (f"{name}{k}",)) for k in range(n)] for name, n in list(sizes.items())[:inputs]]
    extra = (None,) if inputs == 3 else ()
    todo = [x for x in algorithm(mech, *symbols, *extra, Traced) if isinstance(x, Traced)]
    seen: dict[int, Traced] = {}
    while todo:
        node = todo.pop()
        if id(node) not in seen:
            seen[id(node)] = node
            todo += [p for p in node.parts if isinstance(p, Traced)]
    operations = [n for n in seen.values() if n.parts and n.key[0] != "neg"]
    return len(operations), {n.key[0] for n in seen.values() if not n.parts}


def test_absent_terms_cost_no_operation() -> None:
    model = make("two_link")
    operations, _ = trace(recursions.forward_dynamics_crba, model, mechanism(model), 3)
    assert operations <= 41
    by_bodies, _ = trace(articulated.forward_dynamics_aba, model, mechanism(model), 3)
    assert by_bodies <= 43
    weightless = mechanism(model, {f"gravity.{c}": 0.0 for c in "xyz"})
    fewer, inputs = trace(recursions.forward_dynamics_crba, model, weightless, 3)
    assert fewer < operations
    assert "q0" not in inputs  # a fixed base without gravity: the first angle is nowhere
    assert trace(recursions.gravity_torque, model, weightless, 1) == (0, set())


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
        for algorithm in (recursions.rnea, recursions.forward_dynamics_crba, articulated.forward_dynamics_aba):
            regrouped, single = (trace(algorithm, model, read(model), 3)[0] for read in (mechanism, single_bodies))
            assert regrouped < single


@pytest.mark.parametrize("name", ["arm", "panda", "anymal"])
def test_compiled_is_the_same_as_numpy(name: str) -> None:
    case = Case(make(name), 64)
    mech = mechanism(case.model)
    sizes = {"q": case.model.nq, "v": case.model.nv, "u": case.model.nv}
    for algorithm in (recursions.rnea, recursions.forward_dynamics_crba):
        tape = Tape()
        symbols = [list(tape.variables(size)) for size in sizes.values()]
        outputs = algorithm(mech, *symbols, None, tape)  # type: ignore[call-arg]
        compiled = Program(assembled(tape, [x for group in symbols for x in group], outputs))
        ours = case.dense(algorithm(mech, case.q, case.v, case.a, None, np))
        close(compiled(np.concatenate([case.q, case.v, case.a])), ours, 1e-10)


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
