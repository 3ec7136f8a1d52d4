"""Effects of users' own: mistakes are named when the scene is made, and a class defined again has other code."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import solved
from tests.effects.cases import E, robot
from tests.effects.test_closed_forms import wheel
from tests.near import assert_near
from tests.refusals import refusal
from twolink.lagrange.check import arm_urdf

Formula = Callable[[Any], Any]


def of_shoulder(formula: Formula, *, smooth: bool = True) -> tl.effects.Effect:
    """An effect whose torque on the shoulder is a formula of the motion; its class always has the same name."""

    class Own(E.Effect, frozen=True):
        analytic: ClassVar[bool] = smooth

        def act(self, motion: Any, loads: Any) -> None:
            loads.torque(0, formula(motion))

    return Own()


def refused(effect: tl.effects.Effect) -> str:
    with pytest.raises(tl.errors.SceneError) as caught:
        tl.Scene(robot("arm"), effects=[E.Gravity(), effect])
    assert caught.value.where.startswith("effects[1].")
    assert caught.value.remedy
    return str(caught.value)


@pytest.mark.parametrize(("formula", "instead"), [
    (lambda m: m.q[0] ** 3, "q * q * q"),
    (lambda m: 2.0 ** m.q[0], "q * q * q"),
    (lambda m: np.sin(m.q[0]), "write motion.xp.sin"),
    (lambda m: np.sqrt(m.q[0]), "write motion.xp.sqrt"),
    (lambda m: np.log(m.q[0]), "motion.xp's sin, cos"),
    (lambda m: np.exp(m.q[0]), "write motion.xp.exp"),
    (lambda m: math.cos(m.q[0]), "motion.xp.NAME"),
    (lambda m: -1.0 if m.q[0] > 0 else 1.0, "motion.xp.where"),
    (lambda m: 1.0 if m.q[0] == 0 else 0.0, "motion.xp.where"),
    (lambda m: m.q[0] or 1.0, "motion.xp.where"),
    (lambda m: max(m.q[0], m.q[1]), "motion.xp.where"),
    (lambda m: np.maximum(m.q[0], 0.0), "motion.xp.where"),
    (lambda m: abs(m.q[0]), "motion.xp.sqrt"),
    (lambda m: m.q[0] % 6.28, "sines and cosines"),
    (lambda m: m.xp.log(m.q[0]), "motion.xp has sin"),
    (lambda m: m.q[m.coordinate("elbw")[0]], "did you mean 'elbow'"),
    (lambda m: m.position("tp")[0], "did you mean 'tip'"),
    (lambda m: m.velocities[0], "AttributeError"),
    (lambda _: np.array([1.0, 2.0]) * 3.0, "act fails at line"),
])  # fmt: skip
def test_what_cannot_be_compiled_is_refused_with_what_to_write(formula: Formula, instead: str) -> None:
    assert instead in refused(of_shoulder(formula))


_calls: list[Any] = []


def first_angle(motion: Any) -> Any:
    """The angle of the first call."""
    _calls.append(motion.q[0])
    return _calls[0] + motion.q[1]


def last_angle(motion: Any) -> Any:
    """The angle of the call before."""
    _calls.append(motion.q[0])
    return motion.q[0] - _calls[-2] if len(_calls) > 1 else 0.0


def counted(motion: Any) -> Any:
    _calls.append(0)
    return -0.1 * len(_calls) * motion.q[0]


FORGETFUL = {
    "noise": lambda m: 0.1 * np.random.default_rng().normal() - m.q[0],
    "old noise": lambda m: np.random.normal() * m.xp.sin(m.q[1]),  # noqa: NPY002
    "clock": lambda m: time.perf_counter() * m.q[0],
    "counter": counted,
    "first angle": first_angle,
    "last angle": last_angle,
}


@pytest.mark.parametrize("name", FORGETFUL)
@pytest.mark.parametrize("inside", [False, True])
def test_what_changes_from_call_to_call_is_refused(name: str, *, inside: bool) -> None:
    """Traced once, it would be a constant of the motion."""
    _calls.clear()
    effect = of_shoulder(FORGETFUL[name])
    with refusal(
        tl.errors.SceneError, code="not-repeatable", match=r"act of Own gives another load on shoulder"
    ) as caught:
        tl.Scene(robot("arm"), effects=[E.Gravity(), E.Release(effect, at=0.5) if inside else effect])
    assert caught.value.where == ("effects[1].of.act" if inside else "effects[1].act")


def test_a_wrench_that_changes_is_refused_by_its_joint() -> None:
    class Gust(E.Effect, frozen=True):
        def act(self, motion: Any, loads: Any) -> None:
            loads.force("forearm", (np.random.default_rng().normal(), 0.0, motion.t))

    with pytest.raises(tl.errors.SceneError, match="act of Gust gives another load on elbow"):
        tl.Scene(robot("arm"), effects=[Gust()])


def test_what_depends_on_time_is_simulated() -> None:
    """q'' = 6 t under a torque of 6 t I, with I = 0.5 kg m^2: q = t^3."""
    run = solved(wheel(), [of_shoulder(lambda m: 3.0 * m.t)], 1.0, accuracy=1e-8)
    assert_near(run.q[:, 0], run.t**3, 1e-8)


def test_kinks_must_be_declared() -> None:
    def kink(motion: Any) -> Any:
        return motion.xp.where(motion.xp.less(0.0, motion.q[0]), -motion.q[0], 0.0)

    assert "analytic: ClassVar[bool] = False" in refused(of_shoulder(kink))
    tl.Scene(robot("arm"), effects=[of_shoulder(kink, smooth=False)])


class NamesAJoint(E.Effect, frozen=True):
    def act(self, _motion: Any, loads: Any) -> None:
        loads.torque("shoulder", 1.0)


class NoSuchDof(E.Effect, frozen=True):
    def act(self, _motion: Any, loads: Any) -> None:
        loads.torque(2, 1.0)


class OtherArguments(E.Effect, frozen=True):
    def act(self, q: Any, _v: Any, loads: Any) -> None:  # type: ignore[override]
        loads.torque(0, q[0])


class OtherCheck(E.Effect, frozen=True):
    def check(self) -> None:  # type: ignore[override]
        pass


class Returns(E.Effect, frozen=True):
    def act(self, motion: Any, _loads: Any) -> Any:
        return -motion.q[0]


class TwoNumbers(E.Effect, frozen=True):
    def act(self, _motion: Any, loads: Any) -> None:
        loads.force("tip", (1.0, 0.0))


class OtherStates(E.Effect, frozen=True):
    def states(self) -> Any:  # type: ignore[override]
        return {}


class Hydraulic(E.Effect, frozen=True):
    """p' = 1 - p, by the rates of some names."""

    rated: tuple[str, ...]

    def states(self, _motion: Any) -> Any:
        return {"pressure": 0.2}

    def act(self, motion: Any, loads: Any) -> None:
        loads.torque(0, motion.states["pressure"])
        loads.rates.update(dict.fromkeys(self.rated, 1.0 - motion.states["pressure"]))


@pytest.mark.parametrize(("effect", "part"), [
    (NamesAJoint(), "motion.coordinate('shoulder')"),
    (NoSuchDof(), "the robot has 0 to 1"),
    (OtherArguments(), "write def act(self, motion, loads)"),
    (OtherCheck(), "write def check(self, robot)"),
    (Returns(), "act returns a value; add torques by loads.torque"),
    (TwoNumbers(), "test_own_effects.py: IndexError"),
    (OtherStates(), "write def states(self, motion)"),
    (Hydraulic(()), "no rate of 'pressure'"),
    (Hydraulic(("pressure", "presure")), "the rate of 'presure'; states and loads.rates have the same names: pressure"),
])  # fmt: skip
def test_wrong_calls_are_refused_with_the_right_ones(effect: tl.effects.Effect, part: str) -> None:
    assert part in refused(effect)


def test_a_state_follows_its_rate() -> None:
    run = solved(robot("arm"), [Hydraulic(("pressure",))], 1.0)
    assert_near(run.states["pressure"][-1], 1.0 - 0.8 * math.exp(-1.0), 1e-9)


def test_what_is_no_effect_is_told_how_to_become_one() -> None:
    with pytest.raises(tl.errors.SceneError, match="derives from"):
        tl.Scene(robot("arm"), effects=[lambda q: -q])
    with pytest.raises(tl.errors.SceneError, match=r"write Returns\(\.\.\.\)"):
        tl.Scene(robot("arm"), effects=[Returns])


def test_numpy_numbers_and_tables_are_fine() -> None:
    class Table(E.Effect, frozen=True):
        gain: float
        signal: E.Sampled

        def act(self, motion: Any, loads: Any) -> None:
            loads.torque(0, np.float64(self.gain) * motion.q[0] - motion.q[1] / np.float64(2.0))

    tl.Scene(robot("arm"), effects=[Table(2.0, E.Sampled(times=(0.0, 1.0), values=(0.0, 1.0)))])


def test_a_class_defined_again_is_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Code is kept by the name and the numbers of an effect: the formula must count too."""
    monkeypatch.setenv("TWOLINK_CACHE", str(tmp_path))
    ends = {}
    for sign in (-1.0, 1.0):
        run = solved(robot("arm"), [of_shoulder(lambda m, s=sign: s * m.q[0])], 1.0, [0.5, 0.0], method="dop853")
        spring = E.JointSpring({"shoulder": 1.0}) if sign < 0 else None
        ends[sign] = run.q[-1]
        if spring:
            known = solved(robot("arm"), [spring], 1.0, [0.5, 0.0])
            assert_near(run.q[-1], known.q[-1], 2e-9)
    assert abs(ends[1.0] - ends[-1.0]).max() > 0.1


def test_an_effect_of_ones_own_is_not_taken_for_one_of_the_same_name(tmp_path: Path) -> None:
    own = type("JointDamping", (E.JointDamping,), {"__module__": __name__})
    with pytest.raises(tl.errors.SceneError, match="JointDamping is no effect of twolink"):
        tl.Scene(robot("arm"), effects=[own({"elbow": 1.0})]).save(tmp_path / "scene.toml")


def test_an_effect_of_ones_own_cannot_be_saved(tmp_path: Path) -> None:
    """Nor does it leave the file of its robot behind, which is none of the catalogue."""
    own, own_robot = of_shoulder(lambda m: -m.q[0]), tl.load_robot(arm_urdf(1, 2, 3, 4))
    for effect in (own, E.Release(own, at=0.5)):
        with pytest.raises(tl.errors.SceneError, match="Own is no effect of twolink"):
            tl.Scene(own_robot, effects=[effect]).save(tmp_path / "scene.toml")
    assert not any(tmp_path.iterdir())
