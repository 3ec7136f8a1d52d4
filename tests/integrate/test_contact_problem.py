"""The laws of friction in impacts and contact problems, on random bodies: every law is checked on the answer."""

from dataclasses import replace

import numpy as np
import pytest

import twolink as tl
from tests.effects.bodies import G, free_bodies, planar
from twolink.integrate.hybrid import force_share
from twolink.integrate.hybrid.contact_problem import Rows, friction_force, sliding_of, solve_contacts
from twolink.integrate.hybrid.impacts import Touch, after, brought_to_rest
from twolink.integrate.hybrid.least_bounce import LeastBounce
from twolink.integrate.hybrid.state import RunState
from twolink.integrate.motion.scene_equations import equations_of


def antiparallel(force: np.ndarray, slip: np.ndarray) -> float:
    """How far a slip is from being against a force."""
    return float(np.abs(slip * np.linalg.norm(force) + force * np.linalg.norm(slip)).max())


def bodies(seed: int, contacts: int):
    """A mass matrix and rows of contacts of a random system."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(6, 6))
    return random, root @ root.T + np.eye(6), [random.normal(size=(3, 6)) for _ in range(contacts)]


@pytest.mark.parametrize("seed", range(40))
def test_friction_stops_the_slip_or_is_against_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    root = random.normal(size=(2, 2)) * ([1, 1] if seed % 4 else [1, 0])  # one direction cannot move
    gain = root @ root.T * 10 ** random.uniform(-3, 3)
    wanted = gain @ random.normal(size=2)
    for greatest in (0.0, 1e-3, 0.3, 10.0):
        force = friction_force(gain, wanted, greatest)
        slip, size = gain @ force - wanted, np.linalg.norm(wanted)
        assert np.linalg.norm(force) <= greatest * (1 + 1e-12)
        if np.linalg.norm(force) < greatest * (1 - 1e-9):
            assert np.abs(slip).max() < 1e-9 * size
        elif greatest:
            assert antiparallel(force, slip) < 1e-9 * size * greatest


@pytest.mark.parametrize("seed", range(20))
def test_impacts_of_bodies_in_space_obey_newton_and_coulomb(seed: int) -> None:
    """The mass across the normal is not the same in all directions: friction is against the slip all the same."""
    random, mass, (rows,) = bodies(seed, 1)
    v, e, mu = random.normal(size=6), 0.4, random.uniform(0.05, 0.3)
    rows = rows if rows[0] @ v < 0 else -rows
    new, (given,) = after(mass, v, [Touch("body", rows, e, mu, "m/s")], np.empty((0, 6)))
    assert rows[0] @ new == pytest.approx(-e * (rows[0] @ v), abs=1e-12)
    impulse = np.linalg.lstsq(rows.T, mass @ (new - v), rcond=None)[0]
    assert given == pytest.approx(impulse)
    slip, size = rows[1:] @ new, np.linalg.norm(impulse[1:])
    assert size <= mu * impulse[0] * (1 + 1e-9)
    assert np.linalg.norm(slip) < 1e-9 or size == pytest.approx(mu * impulse[0])
    assert antiparallel(impulse[1:], slip) < 1e-9


@pytest.mark.parametrize("seed", range(30))
def test_contact_forces_obey_all_laws(seed: int) -> None:
    random, mass, rows = bodies(seed, 2)
    inverse, free = np.linalg.inv(mass), random.normal(size=6)
    slips = [None, np.array([0.6, 0.8]) if seed % 2 else None]
    contacts = [Rows(own, random.normal(size=3), 0.2, 0.2, slip) for own, slip in zip(rows, slips, strict=True)]
    solved = solve_contacts(free, inverse, contacts)
    a = solved.a
    forces = np.linalg.solve(inverse @ np.concatenate(rows).T, a - free).reshape(2, 3)
    for contact, read, (normal, *force) in zip(contacts, solved.rates, forces, strict=True):
        along, *rates = contact.rows @ a + contact.bias
        slides = sliding_of(contact.friction, contact.slip, read)
        size = np.linalg.norm(force)
        assert size <= 0.2 * normal + 1e-9
        if read[0] > 0.0:
            assert along > 0
            assert normal == pytest.approx(0.0, abs=1e-9)
            continue
        assert normal >= -1e-9
        assert along == pytest.approx(0.0, abs=1e-8)
        if contact.slip is not None:
            assert force == pytest.approx(-0.2 * normal * contact.slip, abs=1e-9)
        elif slides is None:
            assert rates == pytest.approx([0.0, 0.0], abs=1e-8)
        else:
            assert slides == pytest.approx(rates / np.linalg.norm(rates))
            assert force == pytest.approx(-0.2 * normal * np.array(slides), abs=1e-8)


@pytest.mark.parametrize("excess", [-1e-3, -1e-6, 1e-6, 1e-4, 1e-2])
def test_two_corners_at_the_edge_of_their_cones_stick_or_slide(excess: float) -> None:
    """A box that tips over two corners: their shares across the motion undo each other, and friction just holds or not.

    mu: the friction that holding takes, less the excess. In the plane of the motion it is the problem of one point.
    """
    mass, inertia = 1.0, 0.0083
    arm = np.array([0.08, -0.13])  # from the centre to the corners, along x and z
    inverse, rows = np.diag([1 / mass] * 3 + [1 / 0.01, 1 / inertia, 1 / 0.002]), []
    for side in (0.05, -0.05):
        r = np.array([arm[0], side, arm[1]])
        rows.append(np.array([np.append(n, np.cross(r, n)) for n in np.eye(3)[[2, 1, 0]]]))
    free, plane = np.array([0.0, 0.0, -G, 0.0, 12.0, 0.0]), (rows[0] + rows[1])[[0, 2]]
    needed = np.linalg.solve(plane @ inverse @ plane.T, -plane @ free)
    mu = abs(needed[1]) / needed[0] - excess
    solved = solve_contacts(free, inverse, [Rows(own, np.zeros(3), mu, mu, None) for own in rows])
    assert [rate[0] for rate in solved.rates] == [0.0, 0.0]
    one = solve_contacts(free, inverse, [Rows(rows[0] + rows[1], np.zeros(3), mu, mu, None)])
    assert solved.a == pytest.approx(one.a, abs=1e-9)
    assert all(np.any(rate) == (excess > 0) for rate in solved.rates)
    assert all(np.hypot(*force[1:]) <= mu * force[0] * (1 + 1e-9) for force in solved.forces)


@pytest.mark.parametrize("high", [-0.1, 0.2])
def test_the_smallest_forces_on_four_corners_are_taken_while_they_obey_the_laws(
    high: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A block at rest is pushed. Low, all corners have the same forces; high, the rear ones carry too little."""
    fx, push, searches = tl.effects, 0.3 * G, []
    central = force_share._central
    monkeypatch.setattr(force_share, "_central", lambda *given: searches.append(given) or central(*given))
    effects = [fx.Gravity(), fx.FrameWrench("block", (push, 0.0, 0.0), point=(0.0, 0.0, high)),
               fx.Contact(("ground",), 0.5, shapes={"block": (fx.Box((0.3, 0.2, 0.2)),)})]  # fmt: skip
    run = RunState(equations_of(tl.Scene(free_bodies("block"), [0, 0, 0.1, 0, 0, 0, 1], effects=effects)), 0.0)
    run.resolve_mode()
    (forces,) = force_share.share_of(run).best(run.evaluate()).forces
    ahead = push * (0.1 + high) / 0.15  # the load of the two corners in front less that of the others
    each = (G + np.array([ahead, ahead, -ahead, -ahead])) / 4
    assert forces[:, 0] == pytest.approx(each, abs=1e-9)
    assert np.linalg.norm(forces[:, 1:].sum(axis=0)) == pytest.approx(push)
    assert (np.linalg.norm(forces[:, 1:], axis=1) < 0.5 * forces[:, 0]).all()
    assert bool(searches) == (high > 0.0)
    if not searches:
        assert np.linalg.norm(forces[:, 1:], axis=1) == pytest.approx(np.full(4, push / 4))


def test_an_impact_that_friction_holds_without_a_bounce_is_refused() -> None:
    """Friction that sticks pushes a body down by as much as the normal impulse lifts it; Newton asks for a bounce."""
    rows = np.array([[0.1, 0.0], [0.5, 0.0], [0.0, 0.5]])
    touch = Touch("body - ground", rows, 0.5, 0.46, "m/s", 0)
    with pytest.raises(tl.errors.AccuracyError, match="no impulses were found") as caught:
        after(np.eye(2), np.array([-1.0, 0.0]), [touch], np.empty((0, 2)))
    assert caught.value.code == "no-impact"
    low = replace(touch, friction=0.1)
    assert rows[0] @ after(np.eye(2), np.array([-1.0, 0.0]), [low], np.empty((0, 2)))[0] == pytest.approx(0.05)


ROD = """<robot name="rod"><link name="world"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="pin" type="revolute">
<parent link="world"/><child link="rod"/><axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="9" velocity="9"/>
</joint></robot>"""


@pytest.mark.parametrize("friction", [0.2, 0.3, 0.357, 1.0])
def test_what_is_jammed_is_not_pressed_at_will(friction: float) -> None:
    """A rod from a pin to the ground below: from a friction of 0.33 on, any force along it obeys the law of friction.

    Such shares had no number at all. The smallest one holds the rod's weight, and is within its cone.
    """
    tip, ground = tl.effects.Sphere(0.02, (0.0, 0.0, -1.0)), tl.effects.Plane(height=-0.97)
    contact = tl.effects.Contact((("rod", ground),), friction=friction, restitution=0.0, shapes={"rod": (tip,)})
    scene = tl.Scene(tl.load_robot(ROD), [0.6], effects=[tl.effects.Gravity((0.0, 0.0, -10.0)), contact])
    run = tl.simulate(scene, 1.0)
    (pair,) = run.contact_forces
    (x, _, z), angle = run.contact_forces[pair][-1], float(run.q[-1, 0])
    assert -0.97 * x + np.sin(angle) * z == pytest.approx(10.0 * 0.5 * np.sin(angle), rel=1e-9)  # about the pin
    assert abs(x) <= friction * z
    assert z < 10.0


@pytest.mark.parametrize("speed", [1e-3, 1e-4, 1e-5, 1e-6])
def test_a_body_that_rocks_too_low_to_follow_comes_to_rest(speed: float) -> None:
    """Half the mass at each of two ends: one lies, the other bounces as a free point does, until 2 v / (g (1 - e)).

    The end that parts has an acceleration v^2 / 2l towards the other, which no force stops while both are held: sweeps
    found none in 5,000 tries, and runs hung at such ends.
    """
    fx, arm, e = tl.effects, 0.1**0.5, 0.3
    ends = {"body": tuple(fx.Sphere(1e-10, (side * arm, 0.0, 0.0)) for side in (-1, 1))}
    effects = [fx.Gravity(), fx.Contact(("ground",), 0.5, e, shapes=ends)]
    scene = tl.Scene(planar(), [0, 1e-10, 0], [0, speed / 2, speed / 2 / arm], effects)
    result = brought_to_rest(RunState(equations_of(scene), 0.0), LeastBounce(speed**2 / G))
    v, [(_, seconds)], energy = result
    assert np.abs(v).max() < 1e-15
    assert seconds == pytest.approx(2 * speed / (G * (1 - e)), rel=1e-3)
    assert energy == pytest.approx(speed**2 / 4, rel=1e-3)
