"""What is let go, and events of the user's own."""

import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import G, kinds, planar, slider, sliders, solved, times
from tests.effects.cases import E
from tests.near import assert_near
from tests.urdf_text import joint, link, robot_of

THROWER = robot_of(
    link("arm", 2.0, (0.01, 0.2, 0.2), "0.5 0 0"), joint("swing", "revolute", "ground", "arm", "0 -1 0"),
    link("ball", 0.5, 0.001), joint("flight", "floating", "ground", "ball"))  # fmt: skip


def thrower() -> tuple[tl.Robot, dict[str, int]]:
    body = tl.load_robot(THROWER)
    return body, {joint.name: joint.q.start for joint in body.joints}


@pytest.mark.parametrize("how", ["time", "condition"])
def test_a_welded_ball_flies_on_when_it_is_let_go(how: str) -> None:
    """Until then an arm with the ball at its end; from then on, at 1e-10, the parabola from where it was let go."""
    body, at = thrower()
    q = body.neutral.copy()
    q[at["flight"]] = 1.0
    held = E.WeldLoop(a="arm", b="ball", point_a=(1.0, 0.0, 0.0))
    trigger = {"at": 0.25} if how == "time" else {"when": E.JointReaches("swing", 0.4)}
    v = np.zeros(body.nv)
    dofs = {joint.name: joint.v.start for joint in body.joints}
    swing = dofs["swing"]
    v[[swing, dofs["flight"] + 2, dofs["flight"] + 4]] = 4.0, 4.0, -4.0
    scene = tl.Scene(body, q, v, [E.Gravity(), E.Release(held, **trigger)])
    run = tl.simulate(scene, 1.0, accuracy=1e-11)
    angle = run.q[:, at["swing"]]
    # Energy till then: one body of I = 0.2 + 2 / 4 + 0.5 + 0.001, moment of weight (1 + 0.5) g.
    t = times(run, "release")[0]
    inertia, before = 0.2 + 0.5 + 0.5 + 0.001, run.t < t
    energy = inertia * run.v[before, swing] ** 2 / 2 + 1.5 * G * np.sin(angle[before])
    assert np.ptp(energy) < 1e-9
    place = run.q[:, at["flight"] : at["flight"] + 3]
    assert_near(place[before], np.stack([np.cos(angle), 0 * angle, np.sin(angle)], 1)[before], 1e-10)
    late = np.flatnonzero(run.t >= t)[[0, -1]]
    first, last = place[late]
    for i in range(late[0], late[-1]):  # the parabola through the first and the last place
        s, whole = run.t[i] - run.t[late[0]], run.t[late[1]] - run.t[late[0]]
        fall = np.array([0.0, 0.0, G / 2]) * s * (whole - s)
        assert_near(place[i], first + (last - first) * s / whole + fall, 1e-10)
    if how == "time":
        assert t == 0.25
    else:
        reached = tl.simulate(scene, t, accuracy=1e-11).q[-1, at["swing"]]
        assert_near(reached, 0.4, 1e-10)


@pytest.mark.parametrize("when", [{"at": 0.7}, {"when": E.JointReaches("x", 0.0)}])
def test_a_payload_that_is_let_go_makes_the_oscillator_faster(when: dict) -> None:
    """1 + 3 kg on 16 N/m: w = 2; then 1 kg: w = 4, from the place and the velocity it had."""
    load = E.Release(E.Payload("x_link", 3.0), **when)
    run = solved(slider(), [E.JointSpring({"x": 16.0}), load], 3.0, [1.0])
    t1 = when.get("at", math.pi / 4)
    late = run.t - t1
    x1, v1 = math.cos(2 * t1), -2 * math.sin(2 * t1)
    expected = np.where(late < 0, np.cos(2 * run.t), x1 * np.cos(4 * late) + v1 / 4 * np.sin(4 * late))
    assert_near(run.q[:, 0], expected, 1e-9)
    assert kinds(run) == ["release"]
    assert_near(times(run, "release"), [t1], 1e-10)


def test_a_release_at_the_beginning_never_held() -> None:
    run = solved(slider(), [E.Release(E.JointSpring({"x": 16.0}), at=0.0)], 1.0, [1.0], [1.0])
    assert_near(run.q[:, 0] - 1, run.t, 1e-12)


@pytest.mark.parametrize("when", [{"at": math.pi / 4}, {"when": E.JointReaches("x", 0.0)}])
def test_a_second_spring_that_engages_makes_the_oscillator_faster(when: dict) -> None:
    """1 kg on 4 N/m passes 0 at pi / 4 with v = -2; then 16 N/m in all: w = 4."""
    spring = E.Engage(E.JointSpring({"x": 12.0}), **when)
    run = solved(slider(), [E.JointSpring({"x": 4.0}), spring], 3.0, [1.0])
    late = run.t - math.pi / 4
    expected = np.where(late < 0, np.cos(2 * run.t), -0.5 * np.sin(4 * late))
    assert_near(run.q[:, 0], expected, 1e-9)
    assert kinds(run) == ["engage"]  # the first time that the condition is reached counts
    assert_near(times(run, "engage"), [math.pi / 4], 1e-10)


def test_limits_of_effort_begin_and_cease_with_their_effects() -> None:
    """A limited controller is let go where another one engages: a force of 2 N, then one of -1 N, on 1 kg."""

    def held(target: float, limit: float) -> E.JointPD:
        return E.JointPD({"x": target}, {"x": 100.0}, effort={"x": limit})

    run = solved(slider(), [E.Release(held(9.0, 2.0), at=0.5), E.Engage(held(-9.0, 1.0), at=0.5)], 1.0)
    late = np.maximum(run.t - 0.5, 0.0)
    early = np.minimum(run.t, 0.5)
    assert_near(run.q[:, 0], early**2 + late - late**2 / 2, 1e-9)
    assert sorted(kinds(run)) == ["engage", "release"]


def test_watching_a_time_a_condition_and_a_function() -> None:
    def kinetic(motion: object) -> object:
        return motion.v[0] * motion.v[0] / 2 - 0.5

    effects = [
        E.JointSpring({"x": 4.0}),
        E.Watch("noon", at=0.3),
        E.Watch("middle", when=E.JointReaches("x", 0.0)),
        E.Watch("turn", when=E.JointReaches("x", 0.0, of="velocity")),
        E.Watch("right", when=E.FrameReaches("x_link", 0.5, direction=(2.0, 0.0, 0.0))),
        E.Watch("energy", function=kinetic),
    ]
    run = solved(slider(), effects, 3.0, [1.0])
    found = {
        name: [e.t for e in run.events if e.what == name] for name in ("noon", "middle", "turn", "right", "energy")
    }
    pi = math.pi
    assert found["noon"] == [0.3]
    assert_near(found["middle"], [pi / 4, 3 * pi / 4], 1e-9)
    assert_near(found["turn"], [pi / 2], 1e-9)
    assert_near(found["right"], [pi / 6, 5 * pi / 6], 1e-9)
    expected = sorted(t for n in range(3) for t in (n * pi / 2 + pi / 12, n * pi / 2 - pi / 12) if 0 < t < 3)
    assert_near(found["energy"], expected, 1e-9)  # |sin 2 t| = 1/2
    assert_near(run.q[:, 0], np.cos(2 * run.t), 1e-9)


@pytest.mark.parametrize("trigger", [{"at": 0.333}, {"when": E.JointReaches("x", 0.333)}])
def test_a_watch_that_stops_ends_the_run_there(trigger: dict) -> None:
    run = solved(slider(), [E.Watch("end", stop=True, **trigger)], 5.0, v=[1.0])
    assert_near(run.t[-1], 0.333, 1e-12)
    assert_near(run.q[-1, 0], 0.333, 1e-12)
    assert len(run.t) == len(run.q) == len(run.v) == len(run.error)
    assert np.all(np.diff(run.t) > 0)


@pytest.mark.parametrize("at", [0.5, 1.0])
def test_then_gives_a_kick(at: float) -> None:
    """A block at rest in friction is given 2 m/s: it slides 2/3 m."""
    kick = E.Watch("kick", at=at, then=lambda q, v: (q, v + 2.0))
    run = solved(slider(), [E.DryFriction({"x": 3.0}), kick], 3.0)
    late = np.clip(run.t - at, 0, 2 / 3)
    assert_near(run.q[:, 0] - 2 * late + 1.5 * late**2, 0.0, 1e-9)


def test_then_gives_a_kick_that_loops_share() -> None:
    """1 kg that is kicked to 3 m/s and 2 kg coupled to it go on with 1 m/s; q that opens the loop is refused."""
    coupled = [E.Coupling("one", "two", 1.0)]
    kick = E.Watch("kick", at=0.5, then=lambda q, v: (q, np.add(v, (3.0, 0.0))))
    run = solved(sliders(), [*coupled, kick], 1.0)
    assert_near(run.q, np.fmax(run.t - 0.5, 0.0)[:, None] * [1.0, 1.0], 1e-12)
    moved = E.Watch("moved", at=0.5, then=lambda q, v: (np.add(q, (0.1, 0.0)), v))
    with pytest.raises(tl.errors.SceneError, match=r"`then` of 'moved' opens the loops: q is 0\.0667 off"):
        tl.simulate(tl.Scene(sliders(), effects=[*coupled, moved]), 1.0)


@pytest.mark.parametrize("given", [lambda q, v: None, lambda q, v: (q, v * np.nan), lambda q, v: (q[:0], v)])  # noqa: ARG005
def test_then_must_give_a_state(given: object) -> None:
    scene = tl.Scene(slider(), v=[1.0], effects=[E.Watch("bad", at=0.5, then=given)])
    with pytest.raises(tl.errors.SceneError, match="`then` of 'bad' gave no state"):
        tl.simulate(scene, 1.0)


def test_a_release_and_an_impact() -> None:
    """Held up by a force until t = 0.5; then it falls 1 m and stays down."""
    up = E.Release(E.FrameWrench("body", (0.0, 0.0, G)), at=0.5)
    run = solved(planar(), [E.Gravity(), up, E.PlaneContact("body")], 2.0, [0, 1.0, 0])
    assert kinds(run) == ["release", "impact", "rest"]
    assert_near(times(run, "impact"), [0.5 + math.sqrt(2 / G)], 1e-10)


@pytest.mark.parametrize("by", [1.0, 3.0])
def test_a_kick_says_what_energy_it_takes_or_gives(by: float) -> None:
    arm = tl.load_robot("two_link")
    scene = tl.Scene(arm, [1.2, 0.5], [1.0, 0.0], [E.Watch("kick", at=0.0, then=lambda q, v: (q, by * v - 0.5))])
    (event,) = tl.simulate(scene, 0.01).events
    mass = arm.mass_matrix([1.2, 0.5])
    before, after = (0.5 * np.array(v) @ mass @ v for v in ([1.0, 0.0], [by - 0.5, -0.5]))
    assert_near(event.energy, before - after, 1e-12)
    assert str(event).endswith(f"{abs(event.energy):.6g} J {'lost' if by == 1.0 else 'gained'}")


def test_a_sample_at_an_event_has_the_state_after_it() -> None:
    """As `at` has, so that its torques are those of inverse dynamics and its energy that of the book."""
    arm = tl.load_robot("two_link")
    effects = [E.Gravity(), E.Watch("kick", at=0.5, then=lambda q, v: (q, v + 1.0)), E.JointDamping({"elbow": 0.5})]
    run = tl.simulate(tl.Scene(arm, [1.2, 0.5], effects=effects), 1.0)
    k = int(np.searchsorted(run.t, 0.5))
    assert_near(run.v[k], run.at(0.5)[1], 1e-12)
    assert_near(run.v[k] - run.v[k - 1], 1.0, 0.3)
    assert_near(run.tau, arm.inverse_dynamics(run.q, run.v, run.acceleration), 1e-9)
    ball = tl.load_scene("bouncing-ball")
    hit = tl.simulate(ball, accuracy=1e-10).events[0].t
    seen = tl.simulate(ball, 1.0, t_eval=[hit - 1e-6, hit, 1.0], accuracy=1e-10)
    speed = G * hit
    assert_near(seen.v[:2, 0], [-speed, 0.6 * speed], 2e-5)


@pytest.mark.parametrize("at", [0.5, 1.0, 2.0])
def test_energies_have_what_is_held_and_books_close(at: float) -> None:
    """Also where it is let go at the end, or never."""
    arm, load = tl.load_robot("two_link"), E.Payload("forearm", 1.0)
    scene = tl.Scene(arm, [1.2, 0.5], effects=[E.Gravity(), E.Release(load, at=at)], duration=1.0)
    run = tl.simulate(scene, accuracy=1e-9)
    assert_near(run.energy[0], tl.simulate(scene.with_effects([E.Gravity(), load])).energy[0], 1e-9)
    assert_near(tl.energy_book(scene, run).residual, 0.0, 1e-7)


@pytest.mark.parametrize("kick", [{"at": 1.0}, {"at": 0.5, "stop": True}])
@pytest.mark.parts
def test_a_state_that_changes_at_the_end_is_the_last_one(kick: dict) -> None:
    """A log of a longer run that is cut there is right, its energy too."""
    arm = tl.load_robot("two_link")
    watch = E.Watch("kick", then=lambda q, v: (q, 0.5 * v), **kick)
    scene = tl.Scene(arm, [1.2, 0.5], effects=[E.Gravity(), watch], duration=1.0)
    run = tl.simulate(scene, accuracy=1e-9)
    assert_near(run.v[-1], run.at(run.end)[1], 1e-12)
    assert_near(run.v[-1], 0.5 * run.at(run.end - 1e-7)[1], 1e-4)
    assert_near(tl.energy_book(scene, run).residual, 0.0, 1e-7)
    verdict = tl.judge(scene, run)
    assert verdict.right
    assert verdict.energy < 1e-9


def test_an_error_at_a_tick_on_an_event_keeps_the_sample_there() -> None:
    def law(t: float, _: object, state: object) -> tuple[list[float], object]:
        return [1.0 / (0.5 - t) if t == 0.5 else 0.0, 0.0], state

    effects = [E.Gravity(), E.Watch("look", at=0.5), E.Controller(law, period=0.05)]
    with pytest.raises(tl.errors.ControllerError) as caught:
        tl.simulate(tl.Scene(tl.load_robot("two_link"), [1.2, 0.5], effects=effects), 1.0, t_eval=[0.0, 0.5, 1.0])
    assert caught.value.run.t.tolist() == [0.0, 0.5]


@pytest.mark.parametrize("kind", [E.Release, E.Engage])
def test_a_controller_with_states_may_be_the_only_force(kind: type) -> None:
    held = E.PID({"x": 0.4}, kp={"x": 20.0}, ki={"x": 10.0}, kd={"x": 1.0})
    run, beside = (solved(slider(), [*more, kind(held, at=0.3)], 0.6, [0.1])
                   for more in ([], [E.JointDamping({"x": 0.0})]))  # fmt: skip
    assert_near(run.q, beside.q, 1e-8)
    assert abs(run.q[-1, 0] - 0.1) > 0.01
