"""The energy book closes, each effect's work is right by itself, and loops' forces are those of the whole system."""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import twolink as tl
from tests.effects.bodies import ball, slider
from tests.near import assert_near
from tests.scenes.linkages import hanging_four_bars
from twolink.algorithms.motion import KinematicState
from twolink.errors import SceneError
from twolink.integrate.motion.formulas import effect_loads
from twolink.integrate.motion.scene_equations import equations_of

fx = tl.effects


def arm(*effects: fx.Effect) -> tl.Scene:
    return tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], effects=[fx.Gravity(), *effects], duration=2.0)


SCENES = {
    "friction, damping and stops": lambda: arm(
        fx.DryFriction({"shoulder": 2.0, "elbow": 1.0}), fx.JointDamping({"elbow": 0.1}),
        fx.JointStops({"elbow": (-0.2, 1.0)}, 0.5)),
    "a payload that is let go, and a table": lambda: arm(
        fx.Release(fx.Payload("tip", 2.0), at=0.5), fx.Torque({"elbow": fx.Sampled((0.0, 0.3, 2.0), (1.0, 2.0, 3.0))})),
    "a limited motor, friction and stops": lambda: tl.Scene(slider(), duration=4.0, effects=[
        fx.JointPD({"x": fx.Sine(2.0, 1.5)}, {"x": 30.0}, {"x": 0.5}, effort={"x": 3.0}), fx.DryFriction({"x": 0.7}),
        fx.JointStops({"x": (-1.0, 0.8)}, restitution=0.4)]),
    "kicks beside stops": lambda: arm(
        fx.JointStops({"elbow": (-0.2, 1.0)}, 0.6), fx.Watch("kick", at=0.5, then=lambda q, v: (q, v + 1.0)),
        fx.Watch("jump", at=0.9, then=lambda q, v: (q - 0.1, 0.5 * v))),
    "a limited motor": lambda: arm(fx.JointPD({"shoulder": 0.0}, {"shoulder": 90.0}, effort={"shoulder": 30.0})),
    "a ball that bounces, slides and rolls": lambda: tl.Scene(
        ball(), [0, 0, 0.3, 0, 0, 0, 1], [3, 1, 0, 5, -20, 7], duration=2.0,
        effects=[fx.Gravity(), fx.AirDrag("ball", 0.03), fx.PlaneContact("ball", radius=0.1, friction=0.2,
                                                                        restitution=0.3)]),
    "crank-spring": lambda: tl.load_scene("crank-spring"),
    "panda-hold": lambda: tl.load_scene("panda-hold"),
}  # fmt: skip


SLOW = dict.fromkeys(("crank-spring", "a ball that bounces, slides and rolls"), pytest.mark.slow)


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW.get(name, ())) for name in SCENES])
def test_the_book_closes(name: str) -> None:
    scene = SCENES[name]()
    book = tl.energy_book(scene)
    assert_near(book.residual, 0.0, 1e-8 * (1.0 + np.ptp(book.stored)))
    assert set(book.work) == {e for e in book.work if any(np.abs(book.work[e]) > 0)} | {"plane-contact"} & set(
        book.work
    )
    assert "residual" in str(book) == repr(book)
    assert book._repr_html_().startswith("<pre>")


def test_a_scene_that_is_never_so_accurate_has_a_book() -> None:
    """Its loops pass singular positions, where small steps do not get across, nor short parts of steps."""
    book = tl.energy_book(tl.load_scene("four-bar"))
    assert_near(book.residual, 0.0, 1e-6 * book.stored[0])


def test_stepped_contacts_have_no_book() -> None:
    with pytest.raises(SceneError, match="located"):
        tl.energy_book(tl.load_scene("box-stack"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arm-human", "elastic-joint", "geared-motor", "stick-slip"])
def test_the_book_closes_whatever_the_samples_are(name: str) -> None:
    scene = tl.load_scene(name)
    run = tl.simulate(scene, accuracy=1e-9, t_eval=[0.0, scene.duration])
    book = tl.energy_book(scene, run)
    assert_near(book.residual, 0.0, 1e-8 * max(1.0, np.abs([*book.work.values()]).max()))


def test_a_book_begins_with_the_samples() -> None:
    """What impacts and kicks have taken before the first sample is no loss of the part that the samples show."""
    scene, t = SCENES["kicks beside stops"](), np.linspace(0.0, 2.0, 21)
    whole, part = (tl.energy_book(scene, tl.simulate(scene, t_eval=own, accuracy=1e-9)) for own in (t, t[6:]))
    assert whole.lost[6] > 1.0
    assert_near(part.lost, whole.lost[6:] - whole.lost[6], 1e-7)
    assert_near(part.residual, 0.0, 1e-8)


def test_damping_alone_takes_what_is_lost() -> None:
    """By SciPy's quadrature of -d w^2 over dense samples."""
    from scipy.integrate import simpson

    scene = arm(fx.JointDamping({"elbow": 0.3}))
    run = tl.simulate(scene, accuracy=1e-10, samples_per_second=4000)
    work = tl.energy_book(scene, run).work["joint-damping"]
    assert work[-1] == pytest.approx(-simpson(0.3 * run.v[:, 1] ** 2, x=run.t), rel=1e-8)
    assert_near(run.energy[-1] - run.energy[0], work[-1], 1e-8)


ROD = """<mujoco><worldbody><body><joint name="j" axis="{}" armature="0.04"/>
<geom type="capsule" fromto="0 0 0 0.1 0.2 -0.5" size="0.02"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("axis", ["0 1 0", "0 -1 0", "0.6 0.8 0"])
def test_a_pendulum_with_a_rotor_keeps_its_energy(axis: str) -> None:
    """The armature of the file and that of an effect carry kinetic energy, whatever the joint's axis."""
    scene = tl.Scene(
        tl.load_robot(ROD.format(axis)), [1.0], effects=[fx.Gravity(), fx.Rotor({"j": 0.02})], duration=1.0
    )
    run = tl.simulate(scene, accuracy=1e-10)
    kinetic = scene.robot.energy(run.q, run.v)[0]
    np.testing.assert_allclose(kinetic, run.v[:, 0] ** 2 * scene.robot.mass_matrix(run.q)[:, 0, 0] / 2, rtol=1e-13)
    assert np.ptp(kinetic) > 0.1
    assert_near(run.energy, run.energy[0], 1e-10)
    assert_near(tl.energy_book(scene, run).residual, 0.0, 1e-10)


def test_dry_friction_takes_the_path_times_its_level() -> None:
    scene = arm(fx.DryFriction({"elbow": 1.5}))
    book = tl.energy_book(scene)
    fine = tl.simulate(scene, accuracy=1e-9, samples_per_second=20_000)
    assert book.work["dry-friction"][-1] == pytest.approx(-1.5 * np.abs(np.diff(fine.q[:, 1])).sum(), rel=1e-6)


@pytest.mark.parametrize("name", ["four-bar", "crankshaft", "on a bar that turns"])
def test_loop_forces_explain_the_motion(name: str) -> None:
    """M a + h = J^T lambda, with a by differences of the samples' velocities and J by Pinocchio."""
    scene = hanging_four_bars(2, right_length=0.6) if name == "on a bar that turns" else tl.load_scene(name)
    run = tl.simulate(scene, 0.2, accuracy=1e-9, samples_per_second=5000)
    forces = tl.loop_forces(scene, run)
    loops = [e for e in scene.effects if isinstance(e, fx.PointLoop | fx.HingeLoop)]
    model, data = scene.robot.model, scene.robot.model.createData()
    k = 500
    a = (run.v[k + 1] - run.v[k - 1]) / (run.t[k + 1] - run.t[k - 1])
    pin.computeJointJacobians(model, data, run.q[k])
    pin.updateFramePlacements(model, data)
    applied = needed = pin.rnea(model, data, run.q[k], run.v[k], a)
    for loop, rows in zip(loops, forces.values(), strict=True):
        jacobian = np.zeros((3, model.nv))
        for link, point, sign in ((loop.a, loop.point_a, 1.0), (loop.b, loop.point_b, -1.0)):
            if link != "universe":
                frame = model.getFrameId(link)
                whole = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                lever = data.oMf[frame].rotation @ np.array(point)
                jacobian += sign * (whole[:3] - pin.skew(lever) @ whole[3:])
        applied = applied - jacobian.T @ rows[k, :3]
    equations = equations_of(scene)
    motion = KinematicState(model, equations.mechanism, list(run.q[k]), list(run.v[k]), run.t[k], np)
    loads = effect_loads(equations, motion, [], equations.effects)
    assert_near(applied, [float(x) for x in loads.tau], 2e-4 * (1.0 + np.abs(needed).max()))


def test_a_trajectory_without_equations_is_refused() -> None:
    scene = tl.load_scene("crankshaft")
    run = tl.simulate(scene, 0.1)
    with pytest.raises(SceneError, match="has no equations of motion"):
        tl.loop_forces(scene, tl.Trajectory(run.robot, run.t, run.q, run.v, None, None))


@pytest.mark.parametrize("book", [tl.energy_book, tl.loop_forces])
def test_a_run_of_another_scene_is_refused(book: Callable[[tl.Scene, tl.Trajectory], object]) -> None:
    """Works would stand under other effects' names; what is equal is no other scene."""
    scene = arm(fx.DryFriction({"elbow": 1.0}))
    run = tl.simulate(scene, t_eval=[0.0, 0.1])
    book(arm(fx.DryFriction({"elbow": 1.0})), run)
    others = (fx.JointDamping({"elbow": 1.0}), *scene.effects), (fx.Gravity(), fx.DryFriction({"elbow": 2.0}))
    for effects in ((), *others):
        other = tl.Scene(scene.robot, scene.q, scene.v, effects, 0.1)
        with pytest.raises(tl.errors.SceneError, match="another robot or other effects"):
            book(other, run)


class Law:
    """A law that is another object in each copy."""

    def __call__(self, t: float, y: Any, state: Any) -> tuple[Any, Any]:  # noqa: ARG002
        """The torques."""
        return -y.v, state


def test_the_run_of_a_pickle_is_of_its_scene() -> None:
    scene = tl.Scene(tl.load_robot("two_link"), effects=[fx.Gravity(), fx.Controller(Law(), 0.02, state=np.zeros(2))])
    run = tl.simulate(scene, 0.1)
    again = tl.energy_book(scene, pickle.loads(pickle.dumps(run)))
    assert again.work.keys() == tl.energy_book(scene, run).work.keys()
