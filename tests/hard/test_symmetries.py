"""Symmetries of mechanics that no line of the engine states: places, directions and units of mass do not matter."""

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from twolink.dynamics import Robot

FREE = ["box-stack", "can-on-table", "dominoes", "quadruped-stands", "quadruped-trots", "rattleback", "spinning-coin",
        "spinning-top", "tippe-top"]  # fmt: skip
OF_MASSES = ["box-stack", "bouncing-ball", "bricard", "can-on-table", "four-bar", "heavy-top", "newtons-cradle",
             "rattleback", "spinning-coin"]  # whose forces are all in proportion to masses  # fmt: skip


def moved(robot: Robot, q: np.ndarray, angle: float, shift: np.ndarray) -> np.ndarray:
    """The configuration seen by an observer elsewhere, on the same ground."""
    rotation, out = pin.utils.rotate("z", angle), q.copy()
    for joint in robot.joints:
        if joint.kind == "free-flyer":
            first, turn = joint.q.start, joint.q.start + 3
            out[first:turn] = rotation @ q[first:turn] + shift
            out[turn : joint.q.stop] = (pin.Quaternion(rotation) * pin.Quaternion(q[turn : joint.q.stop])).coeffs()
    return robot.normalize(out)


def farthest(robot: Robot, some: np.ndarray, others: np.ndarray) -> float:
    """The largest difference of configurations, rad or m."""
    return max(float(np.abs(pin.difference(robot.model, a, b)).max()) for a, b in zip(some, others, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", FREE)
@pytest.mark.parametrize(("angle", "shift"), [(0.7, (0.0, 0.0, 0.0)), (np.pi / 2, (300.0, -200.0, 0.0))])
def test_motions_are_the_same_elsewhere(name: str, angle: float, shift: tuple[float, float, float]) -> None:
    scene = tl.load_scene(name)
    place = angle, np.array(shift)
    there = tl.Scene(scene.base, moved(scene.robot, scene.q, *place), scene.v, scene.effects, scene.duration)
    run, other = (tl.simulate(each, 1.0, samples_per_second=50) for each in (scene, there))
    seen = np.array([moved(scene.robot, q, *place) for q in run.q])
    assert farthest(scene.robot, seen, other.q) <= run.error.max() + other.error.max() + 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("name", OF_MASSES)
@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_motions_are_the_same_with_all_masses_in_proportion(name: str, factor: float) -> None:
    scene = tl.load_scene(name)
    model = scene.base.model.copy()
    for joint in range(1, model.njoints):
        body = model.inertias[joint]
        model.inertias[joint] = pin.Inertia(body.mass * factor, body.lever, body.inertia * factor)
    heavy = Robot(scene.base.name, model, scene.base.report, scene.base.visuals)
    other = tl.simulate(tl.Scene(heavy, scene.q, scene.v, scene.effects, scene.duration), 1.0, samples_per_second=50)
    run = tl.simulate(scene, 1.0, samples_per_second=50)
    assert farthest(scene.robot, run.q, other.q) <= run.error.max() + other.error.max() + 1e-13
