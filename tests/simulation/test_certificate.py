"""The certificate of laws: runs that obey them have it, and solutions that are changed by hand break the right one."""

from dataclasses import replace

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import G, free_bodies, planar, slider
from tests.refusals import refusal
from twolink.integrate.motion.scene_equations import equations_of
from twolink.integrate.solution import Solution
from twolink.integrate.solver import solve
from twolink.integrate.steps.methods import METHODS
from twolink.simulation.certificate import certificate

E = tl.effects
STOPPED = tl.Scene(slider(), [0.5], effects=[E.Torque({"x": 2.0}), E.JointStops({"x": (-1.0, 1.0)})])
RUBBED = tl.Scene(slider(), [0.0], [2.0], [E.Torque({"x": 0.5}), E.DryFriction({"x": 1.0})])
LANDED = tl.Scene(
    planar(),
    [0.0, 0.2, 0.0],
    [1.0, 0.0, 0.0],
    [E.Gravity(), *(E.PlaneContact("body", point=(s, 0.0, 0.0), friction=0.3) for s in (0.5, -0.5))],
)


def solved(scene: tl.Scene) -> Solution:
    return solve(equations_of(scene), METHODS["dop853"], np.linspace(0.0, 2.0, 201), 1e-9)


def broken(scene: tl.Scene, solution: Solution) -> set[str]:
    """The laws that a solution breaks."""
    switching = equations_of(scene).switching
    found = certificate(switching, solution)
    return {law.law for law in found.laws if law.worst > law.limit}


def with_start(solution: Solution, segment: int, row: int, value: float) -> Solution:
    """The solution with another number in the state at the start of a segment."""
    segments = list(solution.segments)
    start = segments[segment].equations.start.copy()
    start[row] = value
    own = replace(segments[segment].equations, start=start)
    segments[segment] = replace(segments[segment], equations=own, taken=None)
    return replace(solution, segments=tuple(segments))


@pytest.mark.parametrize("scene", [STOPPED, RUBBED, LANDED], ids=["stop", "friction", "contact"])
def test_laws_hold_along_runs(scene: tl.Scene) -> None:
    run = tl.simulate(scene, 2.0)
    assert {"forces", "friction", "mode starts"} <= {law.law for law in run.certificate.laws}
    assert all(law.worst < 1e-9 for law in run.certificate.laws)
    assert "forces" in repr(run.certificate)


def test_smooth_runs_have_none() -> None:
    assert tl.simulate(tl.Scene(slider(), [0.0], [1.0]), 1.0).certificate is None


def test_a_sample_beyond_a_stop_is_an_error_with_its_place() -> None:
    solution, switching = solved(STOPPED), equations_of(STOPPED).switching
    solution.x[0, 150] += 1e-6
    with refusal(tl.errors.AccuracyError, code="laws-violated", match="stops") as caught:
        certificate(switching, solution).require()
    assert caught.value.data["t"] == solution.t[150]
    assert caught.value.data["size"] == pytest.approx(1e-6)


def test_a_stop_that_pulls_and_one_that_is_passed_break_laws() -> None:
    """Pulled: the joint is held at the stop, while the drive would take it away. Free: it starts into the stop."""
    away = tl.Scene(slider(), [1.0], effects=[E.Torque({"x": -2.0}), E.JointStops({"x": (-5.0, 1.0)})])
    solution = solved(away)
    assert broken(away, solution) == set()
    solution.x[:] = [[1.0], [0.0]]
    assert broken(away, with_start(solution, 0, 2, 1.0)) == {"forces"}
    solution = solved(STOPPED)
    assert "mode starts" in broken(STOPPED, with_start(solution, len(solution.segments) - 1, 2, 0.0))


def test_friction_along_the_motion_and_too_little_of_it_break_its_law() -> None:
    solution = solved(RUBBED)
    assert broken(RUBBED, with_start(solution, 0, 3, 1.0)) == {"friction"}
    assert broken(RUBBED, with_start(solution, 0, 3, -0.9)) == {"friction"}


def test_an_impact_that_adds_energy_breaks_a_law() -> None:
    solution = solved(LANDED)
    after = solution.segments[1].equations.start
    assert broken(LANDED, with_start(solution, 1, 3, 1.01 * np.hypot(after[3], 2 * np.sqrt(0.2 * G)))) >= {"impacts"}


def test_a_contact_that_opens_below_the_plane_breaks_laws() -> None:
    solution = solved(LANDED)
    solution.x[1, -1] -= 1e-7
    assert broken(LANDED, solution) == {"gaps", "constraints"}


@pytest.mark.parametrize("points", [(0.5, -0.5), (0.0,)], ids=["shared", "one point"])
def test_a_contact_without_its_share_of_friction_breaks_the_cone(points: tuple[float, ...]) -> None:
    """A run that friction of 0.3 holds on a plane is compared with a scene whose contact has 0.15; 0.2 is needed."""
    robot = planar() if len(points) > 1 else free_bodies("body")
    push = E.FrameWrench("body", (2.0, 0.0, 0.0))
    held, less = (tl.Scene(robot, effects=[E.Gravity(), push, *(
        E.PlaneContact("body", point=(s, 0.0, 0.0), friction=friction) for s in points)])
        for friction in (0.3, 0.15))  # fmt: skip
    solution = solved(held)
    assert broken(held, solution) == set()
    assert broken(less, solution) == {"forces"}
