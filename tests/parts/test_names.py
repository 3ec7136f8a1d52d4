"""Names of joints and links may have dots, spaces and any letters: a robot answers as the one with plain names does."""

import re
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import TOP, answer
from twolink.errors import TwolinkError
from twolink.scenes.parameters import path_of, scene_with

E = tl.effects
TEXT = (TOP / "urdf" / "arm.urdf").read_text(encoding="utf-8")
PLAIN = {name: name for name in ("shoulder", "elbow", "upper_arm", "forearm")}
HARD = [
    {"shoulder": "joint", "elbow": "joint.0", "upper_arm": "rod.com.x", "forearm": "rod.com"},
    {"shoulder": "joint.0.1", "elbow": "joint.0", "upper_arm": "a.mass", "forearm": "a"},
    {"shoulder": "zwei Wörter", "elbow": "関節.damping", "upper_arm": "of", "forearm": "2 ü"},
]


def scene_of(names: dict[str, str]) -> tl.Scene:
    """An arm whose shoulder is driven and stopped, both joints damped, with other names."""
    text = re.sub(r'"(shoulder|elbow|upper_arm|forearm)"', lambda found: f'"{names[found[1]]}"', TEXT)
    shoulder, elbow = names["shoulder"], names["elbow"]
    drive = E.Torque({shoulder: E.Sampled(times=(0.0, 0.2, 0.4), values=(0.0, 0.5, 1.0))})
    effects = [E.Gravity(), E.JointDamping({shoulder: 0.3, elbow: 0.2}), drive, E.JointStops({shoulder: (-0.5, 1.3)})]
    return tl.Scene(tl.load_robot(text), [1.2, 0.7], [1.0, -2.0], effects=effects, duration=0.4)


def renamed(name: str, names: dict[str, str]) -> str:
    """The name of a number, with the names of joints and links replaced."""
    return re.sub("shoulder|elbow|upper_arm|forearm", lambda found: names[found[0]], name)


NUMBERS = {
    "forearm.mass": 1.9, "forearm.com.z": -0.2, "elbow.origin.z": -0.3, "shoulder.armature": 0.01,
    "effects.1.damping.elbow": 0.25, "effects.3.limits.shoulder.1": 1.25, "v.elbow": -1.0, "q.elbow": 0.4,
}  # fmt: skip


@pytest.fixture(params=HARD, ids=["prefix", "number", "unicode"])
def names(request: pytest.FixtureRequest) -> dict[str, str]:
    return request.param


@pytest.mark.some(1)
def test_runs_and_their_derivatives(names: dict[str, str]) -> None:
    plain, scene = scene_of(PLAIN), scene_of(names)
    assert np.array_equal(tl.simulate(scene).q, tl.simulate(plain).q)
    wrt = [name for name in NUMBERS if ".origin." not in name]
    expected = tl.sensitivities(plain, wrt=wrt)
    found = tl.sensitivities(scene, wrt=[renamed(name, names) for name in wrt])
    for name in wrt:
        assert np.array_equal(found.q[renamed(name, names)], expected.q[name]), name


@pytest.mark.some(2)
def test_numbers_are_changed_where_they_are(names: dict[str, str]) -> None:
    constants = {name: x for name, x in NUMBERS.items() if name[1] != "."}
    moved = scene_with(scene_of(names), {renamed(name, names): x for name, x in constants.items()})
    assert np.array_equal(tl.simulate(moved).q, tl.simulate(scene_with(scene_of(PLAIN), constants)).q)
    assert not np.array_equal(tl.simulate(moved).q, tl.simulate(scene_of(names)).q)


@pytest.mark.some(1)
def test_many_worlds(names: dict[str, str]) -> None:
    values = {"forearm.mass": [1.5, 1.9], "effects.1.damping.elbow": [0.1, 0.25]}
    expected = tl.simulate_many(scene_of(PLAIN), parameters=values)
    found = tl.simulate_many(scene_of(names), parameters={renamed(name, names): x for name, x in values.items()})
    assert np.array_equal(found.q, expected.q)


def speed(run: tl.Trajectory) -> float:
    return float(run.v[-1, 1])


@pytest.mark.slow
def test_searches() -> None:
    names = HARD[1]
    wrt = {"v.elbow": (-3.0, 3.0), "effects.2.inputs.shoulder.values.2": (-1.0, 1.0), "forearm.mass": (1.0, 2.0)}
    best = tl.optimize(scene_of(PLAIN), wrt=wrt, objective=speed, starts=1, evaluations=2, curvature=False)
    other = {renamed(name, names): bounds for name, bounds in wrt.items()}
    found = tl.optimize(scene_of(names), wrt=other, objective=speed, starts=1, evaluations=2, curvature=False)
    assert found.objective == best.objective
    run = tl.simulate(scene_of(PLAIN))
    wanted = ["effects.1.damping.elbow", "forearm.mass", "q.shoulder"]
    expected = tl.fit(scene_of(PLAIN), {"t": run.t, "q": run.q}, wanted)
    found = tl.fit(scene_of(names), {"t": run.t, "q": run.q}, [renamed(name, names) for name in wanted])
    for name in wanted:
        assert found.values[renamed(name, names)] == expected.values[name]


def test_the_command_line(tmp_path: Path) -> None:
    names = HARD[2]
    scene = scene_of(names).with_effects(scene_of(names).effects[:2]).save(tmp_path / "scene.toml")
    vary = [part for name, x in NUMBERS.items() if "limits" not in name and name[1] != "."
            for part in ("--vary", f"{renamed(name, names)}={x}")]  # fmt: skip
    found = answer("sweep", str(scene), *vary, "--vary", f"v.{names['elbow']}=1,2", "--out", str(tmp_path / "x.zarr"))
    assert (found["done"], found["failed"]) == (2, 0)


def test_a_name_that_is_nowhere() -> None:
    damping = E.JointDamping({"joint": 0.1, "joint.0": 0.2})
    assert path_of(damping, "damping.joint.0") == ("damping", "joint.0")
    assert path_of(damping, "damping.joint") == ("damping", "joint")
    assert path_of(damping, "damping.joint.0.1") is None
    with pytest.raises(TwolinkError, match=r"no parameter 'effects.1.damping.knee'"):
        scene_with(scene_of(PLAIN), {"effects.1.damping.knee": 1.0})
