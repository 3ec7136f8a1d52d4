"""Logs in degrees are refused before the fit, with the column, its range and what can be pasted; many turns are not."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.identification.motions import motion, noisy
from tests.refusals import refusal
from twolink.errors import QueryError
from twolink.identification import identify, read_log
from twolink.io.tables import write_table

ARM = tl.load_robot("two_link")  # its limits are 1,000 rad: they tell nothing
T, Q, V, A = motion(ARM, 250)
FRICTION = 0.5 * V + 0.8 * np.tanh(V / 0.01)
TAU = noisy(ARM.inverse_dynamics(Q, V, A) + FRICTION, 0.1)


def degrees(folder: Path, of_v: bool = False) -> Path:
    columns = {"t": T, **{f"{n}.{joint}": x[:, k] for n, x in (("q", np.degrees(Q)), ("tau", TAU))
                          for k, joint in enumerate(ARM.joint_names)}}  # fmt: skip
    columns |= {f"v.{joint}": V[:, k] for k, joint in enumerate(ARM.joint_names)} if of_v else {}
    return write_table(folder / "log.csv", columns, {})


@pytest.mark.parametrize("form", ["positions", "with v in rad/s", "all in degrees", "accelerations"])
def test_torques_tell_degrees_where_no_limits_do(form: str) -> None:
    d = np.degrees
    given = {"positions": (d(Q), None, None), "with v in rad/s": (d(Q), V, None), "all in degrees": (d(Q), d(V), None),
             "accelerations": (d(Q), d(V), d(A))}[form]  # fmt: skip
    with refusal(QueryError, code="units", match="is q in degrees") as caught:
        identify(ARM, T, given[0], given[1], TAU, a=given[2])
    column = re.search(r"q\.(\w+) goes from (\S+) to ([^ ,]+),", str(caught.value))
    assert column is not None
    angles = d(Q)[:, ARM.joint_names.index(column[1])]
    np.testing.assert_allclose([float(column[2]), float(column[3])], [angles.min(), angles.max()], rtol=1e-3)


@pytest.mark.parametrize("of_v", [False, True])
def test_the_remedy_can_be_pasted(tmp_path: Path, of_v: bool) -> None:
    path, joints = degrees(tmp_path, of_v), dict[str, object]()
    for _ in ARM.joint_names:
        with pytest.raises(QueryError) as caught:
            identify(ARM, [read_log(ARM, path, {"q": joints}).table])
        pasted = re.search(r"q\.\w+ = \{.*?\}", caught.value.remedy or "")
        assert pasted is not None
        column = pasted[0].partition(" ")[0]
        joints |= tomllib.loads(pasted[0].replace("...", column))["q"]
        if not of_v:  # without velocities one joint in degrees is enough to see, and the other follows
            joints |= {name: {"column": f"q.{name}", "scale": np.pi / 180} for name in ARM.joint_names}
            break
    found = identify(ARM, [read_log(ARM, path, {"q": joints}).table], joint_model="viscous+coulomb")
    assert found.noise.max() < 0.5
    if not of_v:
        by_option = identify(ARM, [read_log(ARM, path, units=["deg"]).table], joint_model="viscous+coulomb")
        np.testing.assert_allclose(by_option.estimate, found.estimate, rtol=1e-6)


def test_a_joint_that_turns_many_times_is_in_radians() -> None:
    """Whether gravity tells it (a pendulum that turns over) or nothing does (a wheel, whose torque is linear in a)."""
    for gravity, parameters in ((-9.81, None), (0.0, ["*.origin_inertia.*"])):
        wheel = tl.load_robot("friction_pendulum", gravity=(0, 0, gravity))
        t, q, v, a = motion(wheel, 400)
        q, v, a = 20 * q, 20 * v, 20 * a
        assert np.abs(q).max() > 4 * np.pi
        identify(wheel, t, q, None, noisy(wheel.inverse_dynamics(q, v, a), 0.1), parameters)


def test_fit_tells_degrees_by_the_start_of_the_scene() -> None:
    """Another motion than the scene's, so that sizes tell nothing, from the same start."""
    scene = tl.Scene(ARM, [0.8, -0.5], effects=[tl.effects.Gravity()], duration=1.0)
    t = np.linspace(0.0, 1.0, 60)
    q = np.degrees(scene.q + np.stack([np.sin(9 * t), 1 - np.cos(7 * t)], axis=1) * 0.3)
    with refusal(QueryError, code="units", match="is q in degrees") as caught:
        tl.fit(scene, {"t": t, "q": q}, ["forearm.mass"])
    assert "45.84" in str(caught.value)
    assert "0.0174533" in (caught.value.remedy or "")


def test_judge_tells_degrees_from_a_start_at_zero() -> None:
    scene = tl.Scene(ARM, [0.0, 0.0], effects=[tl.effects.Gravity()], duration=0.5)
    run = tl.simulate(scene, accuracy=1e-9)
    verdict = tl.judge(scene, (run.t, np.degrees(run.q), np.degrees(run.v)))
    assert not verdict.right
    assert "q and v are in degrees" in str(verdict.causes[0])
    assert verdict.distance.max() < 1e-6
