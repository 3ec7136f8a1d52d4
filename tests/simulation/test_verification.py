"""Error bars where rounding is a large part of the error: accuracies near the limit of double precision, long runs."""

import math

import numpy as np
import pytest

import twolink as tl
from twolink.errors import AccuracyError
from twolink.hard import truths
from twolink.hard.case import Track
from twolink.hard.extended_precision import extended_reference
from twolink.integrate.method_choice import MethodChoice
from twolink.integrate.methods import METHODS
from twolink.integrate.perturbation import NO_PERTURBATION, Perturbation
from twolink.integrate.scene_equations import equations_of
from twolink.integrate.solution import Solution
from twolink.simulation.verification import Solved, second_solutions

pytest.importorskip("heyoka")

G = 9.75
PENDULUM = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 {com}"/>
<mass value="1"/><inertia ixx="0.25" iyy="{inertia}" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="{kind}"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>{limit}</joint></robot>"""
LIMIT = '<limit lower="-1e6" upper="1e6" effort="1e6" velocity="1e6"/>'


def best(scene: tl.Scene, duration: float, accuracy: float, method: str, samples: float) -> tl.Trajectory:
    """The run, or the best one of a refusal."""
    try:
        return tl.simulate(scene, duration, accuracy, method=method, samples=samples)
    except AccuracyError as error:
        return error.run


def near_the_limit(scene: tl.Scene, duration: float, method: str, samples: float) -> tl.Trajectory:
    """A run at 1.1 times what a refused run reached."""
    refused = best(scene, duration, 1e-15, method, samples)
    assert refused.error is not None
    return best(scene, duration, 1.1 * float(refused.error[-1]), method, samples)


def double_pendulum(seed: int) -> tuple[tl.Scene, float]:
    """The paper's arm from a random state, and a random duration."""
    random = np.random.default_rng([5, seed])
    q, v = random.uniform(-3, 3, 2), random.uniform(-3, 3, 2)
    effects = tl.load_scene("arm-swing").effects
    return tl.Scene(tl.load_robot("two_link"), q, v, effects=effects), round(random.uniform(5, 40), 3)


@pytest.mark.parametrize(("method", "seed"), [("auto", 18), ("auto", 27), ("dop853", 0), ("dop853", 27)])
def test_bars_of_double_pendulums_hold_near_the_limit(method: str, seed: int) -> None:
    """Against 19 digits of another tolerance. With second solutions in double precision these were 2.7 to 10 times
    too small."""
    scene, duration = double_pendulum(seed)
    run = near_the_limit(scene, duration, method, 20)
    reference, doubt = extended_reference(scene, run.t)
    true = truths.distance(scene.robot, run.q.astype(np.longdouble), reference)
    assert run.error is not None
    assert (doubt <= 0.1 * run.error)[1:].all()
    assert (true <= run.error)[1:].all()


@pytest.mark.parametrize(("method", "start", "duration"), [("auto", 2.524749203936725, 4236.0),
                                                           ("dop853", 1.0236796294986434, 2439.0)])  # fmt: skip
def test_bars_of_pendulums_hold_over_an_hour(method: str, start: float, duration: float) -> None:
    """Against Jacobi's elliptic functions: I = 1/2 kg m^2, m g c = G / 2."""
    robot = tl.load_robot(PENDULUM.format(kind="revolute", com=-0.5, inertia=0.25, limit=LIMIT))
    scene = tl.Scene(robot, [start], effects=[tl.effects.Gravity((0.0, 0.0, -G))])
    run = near_the_limit(scene, duration, method, 0.1)
    some = np.linspace(1, len(run.t) - 1, 30).astype(int)
    track = Track(run.t[some], run.q[some], run.v[some])
    error = truths.configuration_error(truths.swing(start, math.sqrt(G)))(robot, track)
    assert run.error is not None
    assert (error <= run.error[some]).all()


@pytest.mark.parametrize("many", [False, True])
def test_the_bar_of_a_pendulum_that_turns_freely(many: bool) -> None:
    """At its end the angle from the second solution is a few 1e-9, for which pin.difference returns 0."""
    theta, rate, duration = -1.8581839365982098, 0.009130201103464408, 55.96405641440425
    robot = tl.load_robot(PENDULUM.format(kind="continuous", com=-0.4, inertia=0.01, limit=""))
    scene = tl.Scene(robot, [math.cos(theta), math.sin(theta)], [rate], effects=[tl.effects.Gravity()])
    if many:
        worlds = tl.simulate_many(scene, duration=duration, accuracy=1e-9)
        q, bar = worlds.q, worlds.error
    else:
        run = tl.simulate(scene, duration, 1e-9, samples=1 / duration)
        q, bar = run.q[-1:], None if run.error is None else run.error[-1:]
    reference, doubt = extended_reference(scene, np.array([0.0, duration]))
    true = truths.distance(robot, q.astype(np.longdouble), reference[-1:])
    assert bar is not None
    assert doubt[-1] <= 1e-3 * bar
    assert true <= bar <= 1e-9


def test_bars_of_many_worlds_hold_near_the_limit() -> None:
    """Of 30 double pendulums over 20 s at 1e-12; with one second solution 6 bars were too small, by up to 12."""
    random = np.random.default_rng(3)
    q, v = random.uniform(-3, 3, (60, 2))[:30], random.uniform(-3, 3, (60, 2))[:30]
    scene = tl.load_scene("arm-swing")
    worlds = tl.simulate_many(scene, q, v, duration=20.0, accuracy=1e-12)
    assert worlds.error is not None
    sure = 0
    for i in range(len(q)):
        start = tl.Scene(scene.robot, q[i], v[i], effects=scene.effects)
        reference, doubt = extended_reference(start, np.array([0.0, 20.0]))
        true = truths.distance(scene.robot, worlds.q[i : i + 1].astype(np.longdouble), reference[-1:])
        if doubt[-1] <= 0.1 * worlds.error[i]:
            sure += 1
            assert true <= worlds.error[i], i
    assert sure > 25


@pytest.mark.parametrize(("height", "duration", "accuracy"), [(1.0, 200.0, 1e-9), (1.3, 100.0, 1e-10)])
def test_the_bar_of_an_elastic_ball(height: float, duration: float, accuracy: float) -> None:
    """It bounces without loss: parabolas, which the steps solve exactly, so that rounding is all of the error."""
    robot = tl.load_robot("""<robot name="ball"><link name="world"/><link name="ball"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="z" type="prismatic">
        <parent link="world"/><child link="ball"/><axis xyz="0 0 1"/>
        <limit lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>""")
    scene = tl.Scene(robot, [height], effects=[tl.effects.Gravity((0.0, 0.0, -9.75)),
                                               tl.effects.PlaneContact("ball", restitution=1.0)])  # fmt: skip
    run = tl.simulate(scene, duration, accuracy, samples=10)
    fall = np.sqrt(2 * np.longdouble(height) / 9.75)
    since_top = np.mod(run.t.astype(np.longdouble) + fall, 2 * fall) - fall
    true = np.abs(run.q[:, 0] - (height - 9.75 * since_top**2 / 2)).astype(float)
    assert run.error is not None
    assert (true <= run.error)[1:].all()
    assert run.error[-1] <= accuracy


@pytest.mark.parametrize(
    ("scene", "tolerance", "few_steps", "precisions"),
    [
        ("arm-swing", 1e-9, False, ["double"]),
        ("arm-swing", 1e-13, False, ["extended"]),
        ("crankshaft", 1e-9, False, ["double"]),
        ("crankshaft", 1e-9, True, ["double", "double"]),
        ("crankshaft", 1e-13, False, ["double", "double"]),
    ],
)
def test_second_solutions_where_rounding_counts(
    scene: str, tolerance: float, few_steps: bool, precisions: list[str]
) -> None:
    """Only more digits, or perturbations to both sides, tell errors that rounding decides."""
    asked: list[tuple[MethodChoice, Perturbation]] = []

    def solve(choice: MethodChoice, perturbation: Perturbation = NO_PERTURBATION) -> Solved:
        asked.append((choice, perturbation))
        return solved(choice, 110 if few_steps else 178)

    def solved(choice: MethodChoice, steps: int) -> Solved:
        return Solved(choice, Solution(np.zeros(1), np.zeros((4, 1)), steps, 0), 0.0)

    equations = equations_of(tl.load_scene(scene))
    coarse = solved(MethodChoice(METHODS["dop853"], tolerance, "asked for"), 100)
    others = second_solutions(coarse, solve, equations, 1e-6).solutions
    assert [other.choice.precision for other in others] == precisions
    shifts = [perturbation.start_shift for _, perturbation in asked]
    assert (shifts == [0.0]) == (precisions == ["extended"])
    assert len(shifts) == 1 or shifts[0] * shifts[1] < 0
    again = second_solutions(coarse, solve, equations, 1e-6, others).solutions
    assert (again == others) == (precisions == ["extended"])  # it does not depend on the coarse solution


@pytest.mark.parametrize(
    ("scene", "with_rounding"), [("arm-swing", ["extended"]), ("crankshaft", ["double", "double"])]
)
@pytest.mark.parametrize("rounding", [0.05, 0.5])
def test_a_run_that_starts_roundings_away_tells_whether_rounding_counts(
    scene: str, with_rounding: list[str], rounding: float
) -> None:
    """At a tolerance of 2e-11: below what rounding is in other motions. Its share of the error is 5 or 50 %."""

    def solve(choice: MethodChoice, perturbation: Perturbation = NO_PERTURBATION) -> Solved:
        same = choice == coarse.choice
        assert not same or perturbation.start_shift > 0.0
        return solved(choice, 100 if same else 178, rounding if same else 1.0)

    def solved(choice: MethodChoice, steps: int, off: float) -> Solved:
        return Solved(choice, Solution(t, 1e-9 * off * np.ones((4, 1)) * t, steps, 0), 1.0)

    equations, t = equations_of(tl.load_scene(scene)), np.linspace(0.0, 1.0, 50)
    coarse = solved(MethodChoice(METHODS["dop853"], 2e-11, "asked for"), 100, 0.0)
    others = second_solutions(coarse, solve, equations, 1e-9).solutions
    assert [other.choice.precision for other in others] == (["double"] if rounding < 0.1 else with_rounding)
    assert others[0].seconds == (1.0 if others[0].choice.precision == "extended" else 2.0)


@pytest.mark.parametrize(("method", "accuracy"), [("taylor", 6e-11), ("dop853", 6e-10), ("rk45", 2e-9)])
@pytest.mark.parametrize("seed", [1, 4])
def test_bars_hold_where_rounding_is_measured(method: str, accuracy: float, seed: int) -> None:
    """The tolerance is 2e-11, where rounding is small in most motions; against 19 digits."""
    scene, duration = double_pendulum(seed)
    run = best(scene, duration, accuracy, method, 20)
    reference, doubt = extended_reference(scene, run.t)
    true = truths.distance(scene.robot, run.q.astype(np.longdouble), reference)
    assert run.error is not None
    assert (doubt <= 0.1 * run.error)[1:].all()
    assert (true <= run.error)[1:].all()
