"""explain is quick: it prices what it counts, and runs nothing."""

import time

import numpy as np
import pytest

import twolink as tl
from twolink.integrate.motion.scene_equations import equations_of
from twolink.native import programs
from twolink.native.speed import nanoseconds_of_operation


def test_an_evaluation_is_priced_by_its_operations() -> None:
    scene = tl.load_scene("squeezer")
    explained = tl.explain(scene)
    batch, alone = explained.nanoseconds
    assert 0 < batch < alone  # a batch uses whole vectors
    work = equations_of(scene).operations + 8 * scene.robot.nv + 30
    assert np.allclose(explained.nanoseconds, [work * one for one in nanoseconds_of_operation()])


def test_no_program_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(programs, "arrays_named", None)
    robot = tl.load_robot("panda")
    damped = tl.effects.JointDamping({robot.joints[0].name: 0.1})
    begin = time.process_time()
    explained = tl.explain(tl.Scene(robot, effects=[tl.effects.Gravity(), damped]), 2.0)
    assert time.process_time() - begin < 2.0  # 0.1 s of a machine at rest
    assert 0 < explained.expected_seconds < 1.0
