"""Functions refuse what is no robot, scene or run, and say what would make one."""

import inspect
from typing import Any

import numpy as np
import pytest

import twolink as tl
from twolink.errors import TwolinkError

KINDS = "scene", "robot", "run", "model", "trajectories"
WRONG = None, 3, "no such thing", [1.0, 2.0], {"a": 1}, tl.load_robot, tl.Scene
TAKE_ROBOTS = "judge", "judge_many", "step_table"  # in place of a scene


def needed(name: str) -> list[str]:
    """The arguments that a function needs."""
    parameters = inspect.signature(getattr(tl, name)).parameters.values()
    return [one.name for one in parameters if one.default is one.empty and one.kind is not one.VAR_KEYWORD]


def functions() -> list[str]:
    made = {name for name in dir(tl) if inspect.isclass(getattr(tl, name))} - {"Scene", "Simulation"}
    return [name for name in dir(tl) if callable(getattr(tl, name)) and name not in made]


PAIRS = [(name, kind) for name in functions() for kind in KINDS if kind in needed(name)]


@pytest.fixture(scope="module")
def right() -> dict[str, Any]:
    """Arguments that fit, by name."""
    scene, times = tl.load_scene("arm-swing"), np.linspace(0.0, 1.0, 50)
    return {
        "scene": scene, "robot": scene.robot, "run": tl.simulate(scene, 0.01), "model": scene,
        "trajectories": {"a": "a.csv"}, "trajectory": "a.csv", "objective": max,
        "wrt": {"v.elbow": (-1.0, 1.0)}, "parameters": {"v.elbow": 1.0}, "vary": {"v.elbow": [0.0, 1.0]},
        "out": "a.zarr", "q": [0.0, 0.0], "to": [1.0, 1.0], "t": times,
        "acceleration": 1.0, "M": np.eye(2), "h": np.zeros(2), "period": 1.0, "Q": 1.0, "R": 1.0,
        "measurements": {"t": times, "q0": times, "q1": times},
    }  # fmt: skip


@pytest.mark.parametrize(("name", "kind"), PAIRS)
def test_what_is_none_is_refused(name: str, kind: str, right: dict[str, Any]) -> None:
    function, given = getattr(tl, name), {one: right[one] for one in needed(name)}
    swapped = {"scene": "robot", "robot": "scene", "run": "scene", "model": "run", "trajectories": "trajectory"}[kind]
    for wrong in (*WRONG, *(() if name in TAKE_ROBOTS and swapped == "robot" else (right[swapped],))):
        with pytest.raises(TwolinkError) as refused:
            function(**given | {kind: wrong})
        assert refused.value.argument or refused.value.where


def test_the_pairs_are_most_of_the_functions() -> None:
    assert len(PAIRS) >= 20
