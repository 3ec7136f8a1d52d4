"""The robots known by name: ours in urdf/, and those of example-robot-data.

example-robot-data 6 ships data only; the names are those of its former Python loader, which users know.
"""

from __future__ import annotations

import functools
import sysconfig
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from twolink.errors import RobotError, nearest

Root = Literal["fixed", "free"]

# name -> (file below example-robot-data/robots, whether the robot is meant to stand on its own feet or fly)
_EXAMPLES: dict[str, tuple[str, bool]] = {
    "a1": ("a1_description/urdf/a1.urdf", True),
    "alex_nub_hands": ("alex_description/urdf/alex_nub_hands.urdf", False),
    "alex_psyonic_hands": ("alex_description/urdf/alex_psyonic_hands.urdf", False),
    "alex_sake_hands": ("alex_description/urdf/alex_sake_hands.urdf", False),
    "alexander": ("alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf", True),
    "allegro_left_hand": ("allegro_hand_description/urdf/allegro_left_hand.urdf", False),
    "allegro_right_hand": ("allegro_hand_description/urdf/allegro_right_hand.urdf", False),
    "anymal": ("anymal_b_simple_description/robots/anymal.urdf", True),
    "anymal_c": ("anymal_c_simple_description/urdf/anymal.urdf", True),
    "anymal_kinova": ("anymal_b_simple_description/robots/anymal-kinova.urdf", True),
    "asr_twodof": ("asr_twodof_description/urdf/TwoDofs.urdf", False),
    "b1": ("b1_description/urdf/b1.urdf", True),
    "b1_z1": ("b1_description/urdf/b1-z1.urdf", True),
    "baxter": ("baxter_description/urdf/baxter.urdf", False),
    "bolt": ("bolt_description/robots/bolt.urdf", True),
    "borinot": ("borinot_description/urdf/borinot_flying_arm_2.urdf", True),
    "centauro": ("centauro_description/urdf/centauro.urdf", True),
    "double_pendulum": ("double_pendulum_description/urdf/double_pendulum.urdf", False),
    "double_pendulum_continuous": ("double_pendulum_description/urdf/double_pendulum_continuous.urdf", False),
    "double_pendulum_simple": ("double_pendulum_description/urdf/double_pendulum_simple.urdf", False),
    "finger_edu": ("finger_edu_description/robots/finger_edu.urdf", False),
    "g1": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", True),
    "g1_with_hands": ("g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf", True),
    "go1": ("go1_description/urdf/go1.urdf", True),
    "go2": ("go2_description/urdf/go2.urdf", True),
    "hector": ("hector_description/robots/quadrotor_base.urdf", True),
    "hextilt": ("hextilt_description/urdf/hextilt_flying_arm_5.urdf", True),
    "human": ("human_description/robots/human.urdf", True),
    "hyq": ("hyq_description/robots/hyq_no_sensors.urdf", True),
    "icub": ("icub_description/robots/icub.urdf", True),
    "icub_reduced": ("icub_description/robots/icub_reduced.urdf", True),
    "iris": ("iris_description/robots/iris_simple.urdf", True),
    "kinova": ("kinova_description/robots/kinova.urdf", False),
    "laikago": ("laikago_description/urdf/laikago.urdf", True),
    "panda": ("panda_description/urdf/panda.urdf", False),
    "panda_collision": ("panda_description/urdf/panda_collision.urdf", False),
    "pr2": ("pr2_description/urdf/pr2.urdf", True),
    "quadruped": ("quadruped_description/urdf/quadruped.urdf", True),
    "romeo": ("romeo_description/urdf/romeo.urdf", True),
    "romeo_laas_small": ("romeo_description/urdf/romeo_laas_small.urdf", True),
    "romeo_small": ("romeo_description/urdf/romeo_small.urdf", True),
    "simple_humanoid": ("simple_humanoid_description/urdf/simple_humanoid.urdf", True),
    "simple_humanoid_classical": ("simple_humanoid_description/urdf/simple_humanoid_classical.urdf", True),
    "so100": ("so_arm_description/urdf/so100.urdf", False),
    "so101": ("so_arm_description/urdf/so101.urdf", False),
    "solo8": ("solo_description/robots/solo.urdf", True),
    "solo12": ("solo_description/robots/solo12.urdf", True),
    "talos": ("talos_data/robots/talos_reduced.urdf", True),
    "talos_arm": ("talos_data/robots/talos_left_arm.urdf", False),
    "talos_box": ("talos_data/robots/talos_reduced_box.urdf", True),
    "talos_full": ("talos_data/robots/talos_full_v2.urdf", True),
    "talos_full_box": ("talos_data/robots/talos_full_v2_box.urdf", True),
    "tiago": ("tiago_description/robots/tiago.urdf", False),
    "tiago_dual": ("tiago_description/robots/tiago_dual.urdf", False),
    "tiago_no_hand": ("tiago_description/robots/tiago_no_hand.urdf", False),
    "tiago_pro": ("tiago_pro_description/robots/tiago_pro.urdf", False),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", False),
    "ur3_gripper": ("ur_description/urdf/ur3_gripper.urdf", False),
    "ur3_limited": ("ur_description/urdf/ur3_joint_limited_robot.urdf", False),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", False),
    "ur5_gripper": ("ur_description/urdf/ur5_gripper.urdf", False),
    "ur5_limited": ("ur_description/urdf/ur5_joint_limited_robot.urdf", False),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", False),
    "ur10_limited": ("ur_description/urdf/ur10_joint_limited_robot.urdf", False),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", False),
    "z1": ("z1_description/urdf/z1.urdf", False),
}

_NOT_URDF = {
    "cassie": "example-robot-data describes Cassie in SDF only (it has closed loops, which URDF cannot hold)",
    "talos_legs": "it is not a file: the former loader cut it out of Talos in code",
}


@dataclass(frozen=True)
class Entry:
    """A robot known by name: its URDF, where its meshes are, and the root it is meant to have."""

    name: str
    path: Path
    package_dirs: tuple[Path, ...]
    usual_root: Root
    origin: str


@functools.cache
def examples_share() -> Path | None:
    """The folder that `package://example-robot-data/...` counts from, or None when it is not installed."""
    paths = sysconfig.get_paths()
    for key in ("purelib", "platlib"):
        share = Path(paths[key]) / "cmeel.prefix" / "share"
        if (share / "example-robot-data" / "robots").is_dir():
            return share
    return None


@functools.cache
def our_urdfs() -> Path:
    """The folder of our own URDFs: inside the installed package, or at the top of a checkout."""
    package = Path(__file__).resolve().parent.parent
    installed = package / "urdf"
    return installed if installed.is_dir() else package.parent / "urdf"


def catalogue_names() -> tuple[str, ...]:
    """All names `load_robot` knows here: ours first, then example-robot-data's."""
    ours = sorted(p.stem for p in our_urdfs().glob("*.urdf"))
    examples = [] if examples_share() is None else list(_EXAMPLES)
    return (*ours, *(n for n in examples if n not in ours))


def find(name: str) -> Entry:
    """The catalogue's entry of this name. Raises RobotError with the nearest name when there is none."""
    own = {path.stem: path for path in our_urdfs().glob("*.urdf")}
    if name in own:
        return Entry(name, own[name], (our_urdfs(),), "fixed", "twolink")
    share = examples_share()
    if name in _EXAMPLES and share is not None:
        relative, free = _EXAMPLES[name]
        path = share / "example-robot-data" / "robots" / relative
        return Entry(name, path, (share,), "free" if free else "fixed", "example-robot-data")
    if name in _NOT_URDF:
        raise RobotError(_NOT_URDF[name], where=f"robot {name!r}", remedy="pass a URDF of it")
    if name in _EXAMPLES:
        raise RobotError(
            "example-robot-data is not installed",
            where=f"robot {name!r}",
            remedy="pip install example-robot-data",
        )
    raise RobotError(
        f"no robot of this name, and no such file: {name!r}",
        where="load_robot",
        remedy=f"{nearest(name, catalogue_names())} (`twolink robots` lists them)",
    )
