"""The numbers in urdf/: computed again from where they come from."""

import numpy as np
import pytest

import twolink as tl

# de Leva 1996, table 4, male: mass in % of 73 kg; centre of mass and radii of gyration in % of the length
WEIGHT = 73.0
UPPER_ARM = {"mass": 2.71, "length": 0.2817, "com": 57.72, "radii": (28.5, 26.9, 15.8)}
FOREARM = {"mass": 1.62, "length": 0.2689, "com": 45.74, "radii": (27.6, 26.5, 12.1)}
HAND = {"mass": 0.61, "length": 0.0862, "com": 79.00, "radii": (62.8, 51.3, 40.1)}


def segment(table: dict) -> tuple[float, float, np.ndarray]:
    """Mass [kg], centre of mass from the proximal end [m], (sagittal, transverse, longitudinal) moments [kg m^2]."""
    mass = table["mass"] / 100 * WEIGHT
    radii = np.array(table["radii"]) / 100 * table["length"]
    return mass, table["com"] / 100 * table["length"], mass * radii**2


def test_arm_has_the_inertias_of_de_leva() -> None:
    robot = tl.load_robot("arm")
    upper, lower = robot.model.inertias[1], robot.model.inertias[2]
    mass, com, moments = segment(UPPER_ARM)
    assert upper.mass == pytest.approx(mass, abs=1e-5)
    np.testing.assert_allclose(upper.lever, [0, 0, -com], atol=1e-6)
    np.testing.assert_allclose(upper.inertia, np.diag(moments), atol=1e-8)
    (m1, c1, i1), (m2, c2, i2) = segment(FOREARM), segment(HAND)
    c2 += FOREARM["length"]
    com = (m1 * c1 + m2 * c2) / (m1 + m2)
    across = m1 * (c1 - com) ** 2 + m2 * (c2 - com) ** 2
    assert lower.mass == pytest.approx(m1 + m2, abs=1e-5)
    np.testing.assert_allclose(lower.lever, [0, 0, -com], atol=1e-6)
    np.testing.assert_allclose(lower.inertia, np.diag(i1 + i2 + [across, across, 0]), atol=1e-8)


def test_positive_angles_of_the_arm_are_flexion() -> None:
    """At q = 0 it hangs; flexion of the shoulder by 90 degrees points it forward (+x), of the elbow lifts the hand."""
    robot = tl.load_robot("arm")
    assert np.abs(robot.gravity_torque([0.0, 0.0])).max() < 1e-12
    hold = robot.gravity_torque([np.pi / 2, 0.0])
    assert np.all(hold > 0)  # the muscles flex to hold it forward
    lower, upper = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    np.testing.assert_allclose(np.degrees(lower), [-60, 0])
    np.testing.assert_allclose(np.degrees(upper), [180, 150])
    _, low = robot.energy([0.0, 0.0], [0.0, 0.0])
    _, bent = robot.energy([0.0, 1.0], [0.0, 0.0])
    assert bent > low


BODIES = {"ball": tl.effects.Sphere(0.05), "box": tl.effects.Box((0.1, 0.1, 0.1)),
          "can": tl.effects.Cylinder(0.033, 0.115), "plank": tl.effects.Box((1.0, 0.1, 0.03))}  # fmt: skip


@pytest.mark.parametrize("name", BODIES)
def test_bundled_objects_are_filled_evenly_and_touch_as_they_look(name: str) -> None:
    empty = tl.Scene(tl.load_robot("world"))
    robot = empty.with_object(name).base
    alike = empty.with_object(BODIES[name], mass=robot.mass, name=name).base
    np.testing.assert_allclose(robot.model.inertias[1].inertia, alike.model.inertias[1].inertia, rtol=1e-9)
    assert [solid.shape for solid in robot.solids] == [BODIES[name]]


def test_the_balls_of_the_cradle_touch_at_rest_and_are_solid() -> None:
    robot = tl.load_robot("newtons_cradle")
    places = np.array([robot.frame_pose(robot.neutral, f"ball_{k}")[1] for k in range(1, 6)])
    np.testing.assert_allclose(np.diff(places[:, 0]), 0.1, rtol=1e-15, atol=1e-16)
    for body in list(robot.model.inertias)[1:]:
        np.testing.assert_allclose(body.inertia, np.eye(3) * 0.4 * body.mass * 0.05**2, rtol=1e-12)
