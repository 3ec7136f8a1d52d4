"""A public network on a bundled quadruped: the Go1 policy of MuJoCo Playground at 50 Hz, feet on the ground.

The file is the user's copy: `mujoco_playground/experimental/sim2sim/onnx/go1_policy.onnx` of google-deepmind/
mujoco_playground (Apache 2.0, 0.8 MB). Its maps are those of `play_go1_joystick.py` there.
"""

from pathlib import Path

import twolink as tl

fx = tl.effects
LEGS, HOME = ("FR", "FL", "RR", "RL"), (0.1, 0.9, -1.8, -0.1, 0.9, -1.8) * 2
JOINTS = tuple(f"{leg}_{part}_joint" for leg in LEGS for part in ("hip", "thigh", "calf"))
FEET, RADIUS = tuple(f"{leg}_foot" for leg in LEGS), 0.023  # m
KP, KD = 35.0, 0.5  # N m/rad, N m s/rad


def policy(path: Path, command: tuple[float, float, float], delay: float = 0.0) -> fx.Policy:
    """The network and its maps. command: forward and sideways, m/s, and turning, rad/s."""
    gains = (dict.fromkeys(JOINTS, gain) for gain in (KP, KD))
    inputs = ("base_lin_vel", "base_ang_vel", "projected_gravity", fx.Observed("joint_pos", offset=HOME), "joint_vel",
              "last_action", fx.Observed("command", values=command))  # fmt: skip
    kp, kd = gains
    return fx.Policy(str(path), period=0.02, inputs=inputs, outputs=JOINTS, scale=0.5, offset=HOME, kp=kp, kd=kd,
                     limit="urdf", delay=delay)  # fmt: skip


def scene(path: Path, command: tuple[float, float, float] = (0.5, 0.0, 0.0), delay: float = 0.0) -> tl.Scene:
    """Go1 from its home pose, its feet on the ground."""
    robot = tl.load_robot("go1", root="free")
    q = robot.neutral.copy()
    for name, angle in zip(JOINTS, HOME, strict=True):
        q[next(joint.q for joint in robot.joints if joint.name == name)] = angle
    q[2] = RADIUS - min(float(robot.frame_pose(q, foot)[1][2]) for foot in FEET)
    contact = fx.Contact(tuple((foot, "ground") for foot in FEET), 0.6,
                         shapes={foot: (fx.Sphere(RADIUS),) for foot in FEET})  # fmt: skip
    effects = [fx.Gravity(), contact, policy(path, command, delay)]
    return tl.Scene(robot, q, effects=effects, duration=2.0, title="A public policy on Go1")
