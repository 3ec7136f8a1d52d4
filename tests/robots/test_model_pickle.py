"""Robots survive pickling: the same numbers to the last bit, mimic joints included."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.robots.test_mimic import chain, mimic


def assert_same(one: pin.Model, other: pin.Model, seed: int = 0) -> None:
    rng = np.random.default_rng(seed)
    q = pin.integrate(one, pin.neutral(one), rng.uniform(-1, 1, one.nv))
    v, a = rng.uniform(-1, 1, (2, one.nv))
    for query in (pin.rnea(one, one.createData(), q, v, a), pin.crba(one, one.createData(), q)):
        again = pin.rnea if query.ndim == 1 else pin.crba
        arguments = (q, v, a) if query.ndim == 1 else (q,)
        np.testing.assert_array_equal(again(other, other.createData(), *arguments), query)
    for index in one.mimicking_joints:
        assert str(other.joints[index].extract()) == str(one.joints[index].extract())


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("axis", ["1 0 0", "0 1 0", "0 0 -1", "0 0.6 0.8"])
@pytest.mark.parametrize("multiplier", [1.0, -2.0])
def test_mimic_joints_survive(kind: str, axis: str, multiplier: float) -> None:
    text = chain(("revolute", ""), (kind, mimic("j1", multiplier, 0.2)), ("revolute", ""), axis=axis)
    for root in ("fixed", "free"):
        robot = tl.load_robot(text, mimic=True, root=root)
        again = pickle.loads(pickle.dumps(robot))
        assert_same(robot.model, again.model)
        assert_same(robot.visuals.model, again.visuals.model)


def test_robots_of_the_catalogue_survive() -> None:
    for name, options in {
        "panda": {"mimic": True, "lock": {"panda_joint2": 0.3}}, "anymal": {"root": "free"}, "tiago": {"mimic": True},
    }.items():  # fmt: skip
        robot = tl.load_robot(name, **options)
        again = pickle.loads(pickle.dumps(robot))
        assert_same(robot.model, again.model)
        assert again.report == robot.report
