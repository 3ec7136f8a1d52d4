"""Every effect: against a second implementation, compiled against portable, its operations, and its imports."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.command import printed_by
from tests.effects.cases import CASES, E, robot, state
from tests.integrate.problems import attempted
from tests.near import assert_near
from twolink.algorithms.namespaces import Numbers
from twolink.integrate.motion.effect_numbers import with_effect_numbers
from twolink.integrate.motion.equations import Equations
from twolink.integrate.motion.pinocchio_rate import rate
from twolink.integrate.motion.scene_equations import equations_of, structure_of
from twolink.integrate.steps.methods import METHODS
from twolink.integrate.steps.programs import Programs
from twolink.integrate.steps.step_control import control_rows, initial_state
from twolink.integrate.steps.step_map import step_map

GRAVITY = E.Gravity()


def equations_with(case: str, seed: int = 0) -> Equations:
    chosen = CASES[case]
    q, v = state(robot(chosen.robot), seed)
    return equations_of(tl.Scene(robot(chosen.robot), q, v, effects=[GRAVITY, chosen.effect]))


@pytest.mark.parametrize("case", CASES)
def test_torques_against_a_second_implementation(case: str) -> None:
    equations = equations_with(case)
    model, nq = equations.robot.model, equations.robot.nq
    for seed, t in enumerate((0.0, 0.13, 0.3, 1.1)):
        q, v = state(equations.robot, seed)
        tau = CASES[case].torque(model, q, v, t)
        expected = pin.aba(model, model.createData(), q, v, tau)
        x = np.concatenate([q, v, equations.layout.numbers_at(t)])
        acceleration = rate(equations, t, x[:, None])[nq : equations.moving, 0]
        np.testing.assert_allclose(acceleration, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("case", CASES)
def test_code_for_any_numbers_agrees_with_other_numbers(case: str) -> None:
    """Compiled with the numbers of the robot and the effect as parameters, called with an effect of other numbers."""
    equations = equations_with(case, seed=3)
    base, values = structure_of(equations)
    of_effect = np.array([name.startswith("effects.") for name in base.parameters])
    other = np.where(of_effect, 1.3 * values, values)
    x = np.tile(equations.start[:, None], 4)
    x[: equations.robot.nq] += np.linspace(0.0, 0.3, 4)
    x = equations.space.normalized(x, Numbers)
    ours = Programs(base).rate(np.concatenate([np.full((1, 4), 0.31), x, np.tile(other[:, None], 4)]))
    theirs = rate(with_effect_numbers(equations, dict(zip(base.parameters, other, strict=True))), 0.31, x)
    assert_near(ours, theirs[: len(ours)], 1e-9 * (1 + np.abs(theirs).max()))


@pytest.mark.some(4)
@pytest.mark.parametrize("case", CASES)
def test_compiled_steps_agree_with_portable_ones(case: str) -> None:
    equations = equations_with(case, seed=3)
    method = METHODS["midpoint"] if equations.robot.joints[0].kind == "vector" else METHODS["semi-implicit-euler"]
    compiled, portable = (step_map(equations, method, portable=p) for p in (False, True))
    x = np.repeat(equations.start[:, None], 8, axis=1)
    x[:, 1:] *= np.random.default_rng(0).uniform(0.5, 1.5, (len(x), 7))
    x = equations.space.normalized(x, Numbers)
    start = initial_state(x, 0.31, 1e-3, 5.0, np.inf)
    ours, theirs = attempted(compiled, start), attempted(portable, start)
    assert compiled.compiled
    size = equations.space.size
    assert_near(ours[:size], theirs[:size], 1e-12 * (1 + np.abs(theirs[:size]).max()))
    assert np.array_equal(ours[control_rows(size).time], theirs[control_rows(size).time])


def test_operations_of_absent_and_present_effects() -> None:
    bare = equations_of(tl.Scene(robot("arm"), effects=[GRAVITY])).operations
    damped = tl.Scene(robot("arm"), effects=[GRAVITY, E.JointDamping({"shoulder": 0.3})])
    assert equations_of(damped).operations == bare + 2
    for nothing in (E.JointDamping({"elbow": 0.0}), E.JointSpring({"elbow": 0.0}), E.SmoothFriction({"elbow": 0.0}),
                    E.AirDrag("forearm", 0.0), E.FrameWrench("forearm"), E.SpringBetween("base", "forearm"),
                    E.JointPD({"elbow": 1.0}, {"elbow": 0.0})):  # fmt: skip
        assert equations_of(tl.Scene(robot("arm"), effects=[GRAVITY, nothing])).operations == bare
    weightless = equations_of(tl.Scene(robot("arm"), effects=[E.GravityCompensation()]))
    assert weightless.operations == equations_of(tl.Scene(robot("arm"))).operations
    many = [E.JointDamping({"elbow": 0.3}), E.AirDrag("tip", 0.1), E.JointSpring({"shoulder": 2.0})]
    whole = tl.Scene(robot("arm"), effects=[GRAVITY, *many])
    shares = [equations_of(whole).operations - equations_of(whole.without(1 + i)).operations for i in range(3)]
    assert shares[0] == 2
    assert shares[2] in (2, 3)  # -k q
    assert 10 < shares[1] < 80


def test_constants_that_change_cost_nothing() -> None:
    bare = equations_of(tl.Scene(robot("arm"), effects=[GRAVITY])).operations
    effects = [GRAVITY, E.Payload("tip", 2.0, (0.1, 0.0, 0.0)), E.Rotor({"elbow": 0.1})]
    assert equations_of(tl.Scene(robot("arm"), effects=effects)).operations <= bare + 4


def test_only_what_a_run_uses_is_imported(tmp_path: Path) -> None:
    code = "import sys, twolink as tl; tl.simulate(tl.load_scene('arm-swing'), 0.1); print(*sys.modules)"
    out = printed_by(code, XDG_CACHE_HOME=str(tmp_path), TWOLINK_CACHE=str(tmp_path / "twolink"))
    shared = {"checks", "effect", "inputs", "loops", "own_effects", "quantities", "switching"}  # common to all
    assert {m.split(".")[-1] for m in out.split() if m.startswith("twolink.effects.")} == {"constants", *shared}
    assert not {"sympy", "heyoka"} & set(out.split())
    assert {path.name for path in tmp_path.iterdir()} <= {"twolink"}


def test_two_of_a_kind_add_up() -> None:
    def rate_with(*effects: E.Effect) -> np.ndarray:
        scene = tl.Scene(robot("arm"), [0.1, 0.2], [0.3, 0.4], effects=[GRAVITY, *effects])
        return rate(equations_of(scene), 0.0, np.array([0.1, 0.2, 0.3, 0.4])[:, None])[:, 0]

    twice = rate_with(E.JointDamping({"elbow": 0.2}), E.JointDamping({"elbow": 0.3}))
    np.testing.assert_allclose(twice, rate_with(E.JointDamping({"elbow": 0.5})), rtol=1e-12)
    loads = rate_with(E.Payload("tip", 1.0), E.Payload("tip", 2.0), E.Rotor({"elbow": 0.1}), E.Rotor({"elbow": 0.2}))
    np.testing.assert_allclose(loads, rate_with(E.Payload("tip", 3.0), E.Rotor({"elbow": 0.3})), rtol=1e-12)
