"""Where located contacts cannot go on they are stepped: the part before keeps its bar, the rest has an estimate."""

import functools
import math

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import G, bouncing, free_bodies, grounded, planar, spheres, stepped
from tests.near import assert_near, assert_within
from tests.refusals import refusal
from twolink.contact.spliced import SplicedSolution
from twolink.integrate.hybrid import engine

E = tl.effects
HEIGHT, END = 0.2, 0.4
HIT = math.sqrt(2 * HEIGHT / G)


def box(*effects: tl.effects.Effect) -> tl.Scene:
    """It turns, falls flat on four corners, which share the impact as no law says, and slides to rest."""
    q = [0, 0, 0.05 + HEIGHT, 0, 0, 0, 1]
    shapes = {"a": (E.Box((0.2, 0.3, 0.1)),)}
    return grounded(free_bodies("a"), q, [2.0, 0, 0, 0, 0, 3.0], *effects, friction=0.2, shapes=shapes)


@functools.cache
def spliced() -> tl.Trajectory:
    return tl.simulate(box(), END, samples_per_second=100, patience=4.0)


def test_the_run_says_from_when_on_it_is_an_estimate() -> None:
    run = spliced()
    (event,) = (event for event in run.events if event.kind == "stepped")
    assert event.t == pytest.approx(HIT, rel=2e-6)
    assert (run.bound, run.accuracy) == ("estimated", None)
    for text in (run.text(), run.error_text, run.cost.why):
        assert f"{event.t:.6g} s" in text
    assert "depend on the share" in event.detail
    assert run.certificate is not None


def test_the_part_before_is_the_located_run_with_its_bar() -> None:
    run, located = spliced(), tl.simulate(box(), 0.2, samples_per_second=100)
    assert isinstance(run.solution, SplicedSolution)
    count = len(located.t)
    assert located.bound == "verified"
    assert run.error[:count].max() <= 1e-6
    assert_within(run.q[:count], located.q, run.error[:count])


def test_the_whole_agrees_with_finer_steps_within_the_estimate() -> None:
    run = spliced()
    fine = stepped(box(), END, 2e-4, samples=100)
    off = np.abs(run.robot.difference(run.q, fine.q)).max(axis=1)
    assert (off <= run.error).all()
    assert run.error[-1] < 1e-2
    assert (run.error[1:] >= run.error[:-1]).all()


def test_what_a_run_tells_is_of_both_parts() -> None:
    run = spliced()
    force, slip = run.contact_forces["a - ground"], run.contact_forces.slips["a - ground"]
    landed = run.t > HIT + 0.01
    assert len(force) == len(run.t) == len(slip)
    assert not force[~landed & (run.t < HIT)].any()
    assert force[landed, 2] == pytest.approx(np.full(landed.sum(), G), rel=1e-6)
    impulse = run.contact_forces.impulses["a - ground"]
    assert_near(impulse.t, [HIT], 1e-2)
    assert impulse.p[:, 2].sum() == pytest.approx(G * HIT, rel=0.1)
    q, v = run.at([0.5 * HIT, 0.5 * (HIT + END)])
    assert_near(q[0, 2], 0.05 + HEIGHT - G * HIT**2 / 8, 1e-7)
    assert_near(v[0, 2], -G * HIT / 2, 1e-6)
    assert_near(q[1, 2], 0.05, 1e-6)
    assert run.tau.shape == run.acceleration.shape == run.v.shape
    assert run.cost.steps > run.contact_record["steps"] > 0


def test_an_error_at_the_splice_grows_as_motions_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball that goes on from its first bounce: the bar there, also of the velocity, leads ever farther away."""
    scene = grounded(planar(), [0, 0.1 + HEIGHT, 0], [1, 0, 0], restitution=0.5, shapes=spheres("body"))
    monkeypatch.setattr(engine, "MAX_EVENTS", 0)
    run = tl.simulate(scene, 0.45, samples_per_second=40, patience=2.0)
    bar, late = run.error[run.t < HIT][-1], run.t > HIT
    assert 2.5 * bar < run.error[-1] < 1e-6
    assert (run.error[late] >= 2.0 * bar).all()
    truth = np.column_stack([run.t, 0.1 + bouncing(run.t, HEIGHT, 0.5), 0.0 * run.t])
    assert_within(run.q, truth, run.error)


def test_controllers_and_sensors_are_stepped_throughout() -> None:
    run = tl.simulate(box(E.Imu("a", period=0.01)), END, samples_per_second=20, patience=0.5)
    assert not any(event.kind == "stepped" for event in run.events)
    assert "stepped, for located" in run.cost.why
    assert run.bound == "estimated"


def test_what_cannot_be_stepped_keeps_the_reason_and_the_run_so_far() -> None:
    with refusal(tl.errors.AccuracyError, code="indeterminate-forces") as refused:
        tl.simulate(box(E.Watch("w", at=0.05)), END, samples_per_second=20)
    assert refused.value.run.t[-1] == pytest.approx(HIT, rel=1e-5)
