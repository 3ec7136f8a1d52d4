"""Refused arguments of effects: the error names the field, the value, and the nearest right name."""

import numpy as np
import pytest

import twolink as tl
from tests.effects.cases import E, assert_refused, robot
from twolink.errors import SceneError

NAN = float("nan")
ALONE, BOTH = {"elbow": 1.0}, {"shoulder": 0.0, "elbow": 0.0}
LINEAR = E.Sampled((0.0, 1.0), (0.0, 1.0))
BAD = [
    (E.JointSpring({"elbow": NAN}), "stiffness.elbow", "at least 0, got nan"),
    (E.JointSpring({"elbow": -1.0}), "stiffness.elbow", "at least 0"),
    (E.JointSpring({"elbw": 1.0}), "stiffness", "there is no joint 'elbw'; did you mean 'elbow'"),
    (E.JointSpring({}), "stiffness", "names no joint"),
    (E.JointSpring(3.0), "stiffness", "values by joint, got 3.0"),
    (E.JointSpring({"elbow": 1.0}, {"shoulder": 1.0}), "rest", "with a stiffness 'shoulder'"),
    (E.JointSpring({"elbow": 1.0}, {"elbow": np.inf}), "rest.elbow", "finite"),
    (E.JointDamping({"elbow": NAN}), "damping.elbow", "finite"),
    (E.JointDamping({}), "damping", "names no joint"),
    (E.JointDamping(), "damping", "the URDF gives no joint damping"),
    (E.SmoothFriction(), "friction", "the URDF gives no joint friction"),
    (E.SmoothFriction({"elbow": 1.0}, 0.0), "scale", "above 0"),
    (E.SmoothFriction({"elbow": -1.0}), "friction.elbow", "at least 0"),
    (E.AirDrag("forarm", 1.0), "frame", "there is no frame 'forarm'; did you mean 'forearm'"),
    (E.AirDrag("base", 1.0), "frame", "does not move"),
    (E.AirDrag("universe", 1.0), "frame", "does not move"),
    (E.AirDrag("forearm", -1.0), "area", "at least 0"),
    (E.AirDrag("forearm", 1.0, wind=(0.0, NAN, 0.0)), "wind[1]", "finite"),
    (E.AirDrag("forearm", 1.0, wind=3.0), "wind", "expected three"),
    (E.AirDrag("forearm", 1.0, point=(0.0, NAN, 0.0)), "point", "finite"),
    (E.FrameWrench("tp"), "frame", "did you mean 'tip'"),
    (E.FrameWrench("tip", axes="local"), "axes", "'local' is unknown"),
    (E.FrameWrench("tip", (1.0, "x", 0.0)), "force[1]", "expected a number, Polynomial"),
    (E.FrameWrench("tip", moment=(1.0, 0.0)), "moment", "expected three"),
    (E.SpringBetween("tip", "tipp"), "second", "did you mean 'tip'"),
    (E.SpringBetween("tip", "forearm"), "second", "do not move against each other"),
    (E.SpringBetween("base", "universe"), "second", "do not move against each other"),
    (E.SpringBetween("base", "tip", rest_length=-1.0), "rest_length", "at least 0"),
    (E.SpringBetween("base", "tip", force=E.Sine(NAN, 1.0)), "force.amplitude", "finite"),
    (E.Torque({"elbow": E.Bezier((), 1.0)}), "inputs.elbow.points", "expected control points"),
    (E.Torque({"elbow": E.Bezier((1.0, 2.0), 0.0)}), "inputs.elbow.duration", "above 0 s, got 0.0"),
    (E.Torque({}), "inputs", "names no joint"),
    (E.Torque({"elbw": 1.0}), "inputs", "there is no joint 'elbw'; did you mean 'elbow'"),
    (E.PointLoop(a="tp"), "a", "there is no frame 'tp'; did you mean 'tip'"),
    (E.WeldLoop(a="tip", point_b=(0.0, NAN, 0.0)), "point_b", "finite"),
    (E.HingeLoop(a="tip", axis_a=(0.0, 1.0), axis_b=(0.0, 1.0, 0.0)), "axis_a", "expected three"),
    (E.HingeLoop(a="tip", axis_a=(0.0, 1.0, 0.0), axis_b=(0.0, 0.0, 0.0)), "axis_b", "expected a direction"),
    (E.Constants({"forearm.mas": 1.0}), "values", "did you mean 'forearm.mass'"),
    (E.Constants({"forearm.mass": -1.0}), "values.forearm.mass", "at least 0"),
    (E.Constants({"elbow.damping": 1.0}), "values.elbow.damping", "damping acts as an effect"),
    (E.Rotor({"elbow": -1.0}), "inertia.elbow", "at least 0"),
    (E.Rotor({"elbow": 1.0}, {"shoulder": 2.0}), "ratio", "with an inertia 'shoulder'"),
    (E.Payload("tip", -1.0), "mass", "at least 0, got -1.0"),
    (E.Payload("tip", NAN), "mass", "finite"),
    (E.Payload("base", 1.0), "frame", "does not move"),
    (E.Payload("tip", 1.0, inertia=(1.0, 0, 0, 1.0, 0, 5.0)), "inertia", "no body has the inertia"),
    (E.Payload("tip", 0.0, inertia=(1.0, 0, 0, 1.0, 0, 1.0)), "inertia", "with 0 kg"),
    (E.JointPD({"elbow": 1.0}, {}), "kp", "kp for joint 'elbow'"),
    (E.JointPD({"elbow": 1.0}, {"elbow": 1.0, "shoulder": 1.0}), "kp", "joint with a target 'shoulder'"),
    (E.JointPD({"elbow": 1.0}, {"elbow": -1.0}), "kp.elbow", "at least 0"),
    (E.JointPD({"elbow": NAN}, {"elbow": 1.0}), "target.elbow", "finite"),
    (E.JointPD({"elbow": 1.0}, {"elbow": 1.0}, effort={"elbw": 1.0}), "effort", "mean 'elbow'"),
    (E.JointPD({"elbow": 1.0}, {"elbow": 1.0}, effort="URDF"), "effort", "'urdf'"),
    (E.ComputedTorque(ALONE, 1.0, 1.0), "path", "it has no path for 'shoulder'"),
    (E.ComputedTorque({**BOTH, "elbow": LINEAR}, 1.0, 1.0), "path.elbow.interpolation", "cubic"),
    (E.ComputedTorque(BOTH, np.inf, 1.0), "kp", "finite"),
    (E.ComputedTorque(ALONE, 1.0, 1.0, following={"shoulder": {"elbo": 1.0}}), "following.shoulder", "mean 'elbow'"),
    (E.ComputedTorque(BOTH, 1.0, 1.0, following={"elbow": {"shoulder": 1.0}}), "following.elbow", "its own"),
    (E.ComputedTorque(ALONE, 1.0, 1.0, following={"shoulder": {"elbow": "x"}}), "following.shoulder.elbow", "finite"),
    (E.GravityCompensation(("elbw",)), "joints", "mean 'elbow'"),
    (E.GravityCompensation(("elbow", "elbow")), "joints", "each once"),
    (E.GravityCompensation(()), "joints", "each once"),
    (E.JointPD({"elbow": 1.0}, kp=50), "kp", "expected values by joint, got 50"),
    (E.DryFriction({"elbw": 1.0}), "kinetic", "did you mean 'elbow'"),
    (E.DryFriction({}), "kinetic", "names no joint"),
    (E.DryFriction(), "kinetic", "the URDF gives no joint friction"),
    (E.DryFriction("URDF"), "kinetic", "expected values by joint or 'urdf', got 'URDF'"),
    (E.DryFriction({"elbow": -1.0}), "kinetic.elbow", "at least 0"),
    (E.DryFriction({"elbow": NAN}), "kinetic.elbow", "finite"),
    (E.DryFriction({"elbow": 1.0}, {"shoulder": 2.0}), "static", "kinetic friction"),
    (E.DryFriction({"elbow": 1.0}, {"elbow": 0.5}), "static.elbow", "below the kinetic"),
    (E.DryFriction({"elbow": 1.0}, {"elbow": np.inf}), "static.elbow", "finite"),
    (E.JointStops({"elbw": (-1.0, 1.0)}), "limits", "did you mean 'elbow'"),
    (E.JointStops({"elbow": (1.0, -1.0)}), "limits.elbow", "expected (lower, upper)"),
    (E.JointStops({"elbow": (1.0, 1.0)}), "limits.elbow", "expected (lower, upper)"),
    (E.JointStops({"elbow": (NAN, 1.0)}), "limits.elbow", "expected (lower, upper)"),
    (E.JointStops({"elbow": (1.0,)}), "limits.elbow", "expected (lower, upper)"),
    (E.JointStops({"elbow": 3.0}), "limits.elbow", "expected (lower, upper)"),
    (E.JointStops({"elbow": (0.0, 1.0)}, restitution=1.1), "restitution", "from 0 to 1"),
    (E.JointStops({"elbow": (0.0, 1.0)}, restitution=-0.1), "restitution", "at least 0"),
    (E.JointStops({"elbow": (0.0, 1.0)}, restitution=NAN), "restitution", "finite"),
    (E.JointStops({}), "limits", "no joint"),
    (E.JointStops({"elbow": (-np.inf, np.inf)}), "limits", "stop"),
    (E.JointStops("URDF"), "limits", "expected values by joint"),
    (E.PlaneContact("tp"), "frame", "did you mean 'tip'"),
    (E.PlaneContact("base"), "frame", "does not move"),
    (E.PlaneContact("tip", normal=(0.0, 0.0, 0.0)), "normal", "expected a direction"),
    (E.PlaneContact("tip", normal=(0.0, 1.0)), "normal", "three"),
    (E.PlaneContact("tip", radius=-1.0), "radius", "at least 0"),
    (E.PlaneContact("tip", friction=-1.0), "friction", "at least 0"),
    (E.PlaneContact("tip", friction=NAN), "friction", "finite"),
    (E.PlaneContact("tip", height=np.inf), "height", "finite"),
    (E.PlaneContact("tip", restitution=2.0), "restitution", "from 0 to 1"),
    (E.PlaneContact("tip", point=(0.0, NAN, 0.0)), "point", "finite"),
    (E.CompliantContact("tip", 1e3, radius=0.1, radii=(1, 1, 1)), "radii", "radius is given too"),
    (E.CompliantContact("tip", 1e3, radii=(0.1, 0.0, 0.1)), "radii[1]", "above 0"),
    (E.CompliantContact("tip", -1.0), "stiffness", "at least 0"),
    (E.CompliantContact("tip", 1.0, slip=0.0), "slip", "above 0"),
    (E.PlaneContact("tip", radius=0.1, radii=(1, 1, 1)), "radii", "radius is given too"),
    (E.PlaneContact("tip", radii=(0.1, 0.0, 0.1)), "radii[1]", "above 0"),
    (E.Release(E.Payload("tip", -1.0), at=1.0), "of.mass", "at least 0"),
    (E.Release(E.Payload("tip", 1.0)), "at", "neither"),
    (E.Release(E.Payload("tip", 1.0), at=1.0, when=E.JointReaches("elbow", 1.0)), "at", "both"),
    (E.Release(E.Payload("tip", 1.0), at=-1.0), "at", "at least 0"),
    (E.Release(E.Payload("tip", 1.0), when=E.JointReaches("elbw", 1.0)), "when.joint", "did you mean 'elbow'"),
    (E.Release(E.DryFriction({"elbow": 1.0}), at=1.0), "of", "cannot be released"),
    (E.Release(3.0, at=1.0), "of", "cannot be released"),
    (E.Watch("a"), "at", "neither"),
    (E.Watch("a", at=NAN), "at", "finite"),
    (E.Watch("a", at=1.0, direction=2), "direction", "2 is unknown; known: -1, 0, 1"),
    (E.Watch("a", at=1.0, direction="up"), "direction", "'up' is unknown; known: -1, 0, 1"),
    (E.Watch("a", when=E.JointReaches("elbow", NAN)), "when.value", "finite"),
    (E.Watch("a", when=E.JointReaches("elbow", 1.0, of="speed")), "when.of", "unknown"),
    (E.Watch("a", when=E.FrameReaches("tp", 1.0)), "when.frame", "did you mean 'tip'"),
    (E.Watch("a", when=E.FrameReaches("tip", 1.0, direction=(0.0, 0.0, 0.0))), "when.direction", "direction"),
    (E.Watch("a", function=3.0), "function", "expected a function"),
    (E.Watch("a", function=abs, at=1.0), "function", "beside"),
    (E.Watch("a", at=1.0, then=3.0), "then", "expected a function"),
    (E.Engage(E.Payload("tip", 1.0), at=0.5), "of", "velocities would jump"),
    (E.Engage(E.DryFriction({"elbow": 1.0}), at=0.5), "of", "cannot be engaged"),
    (E.Engage(E.JointDamping({"elbow": 1.0})), "at", "neither"),
    (E.Detent("elbw", 1.0), "joint", "did you mean 'elbow'"),
    (E.Detent("elbow", -1.0), "torque", "at least 0"),
    (E.Detent("elbow", 1.0, positions=()), "positions", "no notch"),
    (E.Detent("elbow", 1.0, positions=(NAN,)), "positions", "finite"),
    (E.Detent("elbow", 1.0, speed=-1.0), "speed", "at least 0"),
]


@pytest.mark.parametrize(("effect", "where", "part"), BAD)
def test_effects_that_are_refused(effect: object, where: str, part: str) -> None:
    assert_refused(robot("arm"), effect, where, part)


WORKING = {
    "AirDrag": {"frame": "tip", "area": 0.1},
    "Constants": {"values": {"forearm.mass": 1.0}},
    "ComputedTorque": {"path": {"shoulder": 1.0, "elbow": 1.0}, "kp": 1.0, "kd": 1.0},
    "FrameWrench": {"frame": "tip"},
    "Gravity": {},
    "GravityCompensation": {},
    "JointDamping": {"damping": {"elbow": 1.0}},
    "JointPD": {"target": {"elbow": 1.0}, "kp": {"elbow": 1.0}},
    "JointSpring": {"stiffness": {"elbow": 1.0}},
    "Payload": {"frame": "tip", "mass": 1.0},
    "Rotor": {"inertia": {"elbow": 1.0}},
    "SmoothFriction": {"friction": {"elbow": 1.0}},
    "SpringBetween": {"first": "base", "second": "tip"},
    "Torque": {"inputs": {"elbow": 1.0}},
}
WRONG = [50, "x", [1], (1, 2), (None,) * 3, (None,) * 6, {"elbow": None}, {"elbow": [1]}, {3: 1.0}, object()]
FIELDS = [(name, field) for name in WORKING for field in getattr(E, name).__struct_fields__]


@pytest.mark.parametrize(("name", "field"), FIELDS)
def test_values_of_the_wrong_type_are_refused_by_field(name: str, field: str) -> None:
    tl.Scene(robot("arm"), effects=[getattr(E, name)(**WORKING[name])])
    accepted = [value for value in WRONG if not _refused_by_field(name, field, value)]
    assert len(accepted) <= 1  # 50 is right for a number; nothing else fits


def _refused_by_field(name: str, field: str, value: object) -> bool:
    """Whether a value is refused, and by the field's name; what is not refused must be simulated."""
    try:
        scene = tl.Scene(robot("arm"), effects=[getattr(E, name)(**{**WORKING[name], field: value})])
    except SceneError as error:
        return field in error.where
    assert np.isfinite(tl.simulate(scene, 1e-3, method="rk4", step=1e-3, verify=False).q).all()
    return False


def test_locked_joints_and_free_roots() -> None:
    """The error says that a joint is locked; frames on a locked joint move with the other joints."""
    floating = robot("floating")
    for effect in (E.JointSpring({"wrist_1_joint": 1.0}), E.JointDamping({"wrist_1_joint": 1.0})):
        with pytest.raises(SceneError, match="joint 'wrist_1_joint' is locked"):
            tl.Scene(floating, effects=[effect])
    with pytest.raises(SceneError, match="one degree of freedom 'root_joint'"):
        tl.Scene(floating, effects=[E.Rotor({"root_joint": 1.0})])
    tl.Scene(floating, effects=[E.FrameWrench("base_link", (1.0, 0.0, 0.0)), E.Payload("wrist_1_link", 1.0)])
    held = tl.load_robot("two_link", lock={"elbow": 0.4})
    tl.Scene(held, effects=[E.SpringBetween("base", "forearm", 10.0), E.AirDrag("tip", 1.0)])


def test_a_payload_adds_to_the_mass_of_the_scenes_robot_only() -> None:
    arm = robot("arm")
    scene = tl.Scene(arm, effects=[E.Payload("tip", 2.5)])
    assert scene.robot.mass == arm.mass + 2.5
    assert np.array_equal(arm.model.armature, [0, 0])
    q = np.array([0.3, 0.4])
    assert not np.allclose(scene.robot.mass_matrix(q), arm.mass_matrix(q))
