"""Every MJCF below some folders: accelerations equal to MuJoCo's, or a refusal that names the part. No third outcome.

    python -m scripts.studies.mjcf FOLDER... [--states 100] [--tolerance 1e-10] [--arguments NAME=VALUE,...]

MuJoCo's accelerations are those of `mj_forward` with random joint torques, without contacts, limits, loops and joint
friction, and without commands. Ours are those of the scene that `tl.scene_of` makes, without what is left out there.
They are equal where no entry differs by more than the tolerance, relative to the largest one and to 1. Files that are
no models, which others include, are named. One line a file; ends 0 if there is no third outcome.

Every xacro of a URDF below them loads, without ROS, or is refused by name: packages are looked for in the folders, the
arguments are its own. Files that define macros alone have no links, and are refused so.
"""

import sys
from collections import Counter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

import twolink as tl
from scripts.runner import options
from twolink.algorithms.motion import KinematicState
from twolink.effects.effect import Effect, Loads
from twolink.effects.joint_switches import DryFriction, JointStops
from twolink.effects.loops import Loop
from twolink.errors import TwolinkError
from twolink.integrate.hybrid.snapshot import Evaluator
from twolink.integrate.motion.scene_equations import equations_of


class Applied(Effect, frozen=True):
    """Joint torques tau (nv), constant along v."""

    tau: tuple[float, ...]

    def act(self, motion: KinematicState, loads: Loads) -> None:
        """Add tau."""
        del motion
        loads.torques(self.tau)


def smooth_mujoco(path: Path) -> mujoco.MjModel:
    """The model without constraints and commands."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    for name in ("gaintype", "biastype", "dyntype", "gainprm", "biasprm"):
        getattr(model, f"actuator_{name}")[:] = 0
    if model.nplugin:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    return model


def difference(robot: tl.Robot, model: mujoco.MjModel, states: int, seed: int = 1) -> float:
    """The largest difference of an acceleration over random states, relative to the largest one and to 1."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    scene = tl.scene_of(robot)
    tau = np.concatenate([pin.crba(tree.model, data, scene.q[tree.q]) @ rng.normal(size=tree.model.nv)
                          for tree, data in zip(robot.trees, robot.tree_data, strict=True)])  # fmt: skip
    effects = [e for e in scene.effects if not isinstance(e, (DryFriction, JointStops, Loop))]
    equations = equations_of(tl.Scene(robot, scene.q, scene.v, [*effects, Applied(tuple(tau))]))
    q = [pin.integrate(robot.model, scene.q, rng.uniform(-1, 1, robot.nv)) for _ in range(states)]
    v = rng.normal(size=(states, robot.nv))
    ours = Evaluator(equations).by_numpy(np.zeros(states), np.concatenate([np.array(q), v], axis=1).T).a.T
    worst = 0.0
    for k in range(states):
        theirs = accelerations(robot, model, data, q[k], v[k], tau)
        worst = max(worst, float(np.abs(ours[k] - theirs).max() / max(1.0, np.abs(theirs).max())))
    return worst


def accelerations(
    robot: tl.Robot, model: mujoco.MjModel, data: mujoco.MjData, q: np.ndarray, v: np.ndarray, tau: np.ndarray
) -> np.ndarray:
    """MuJoCo's accelerations in our coordinates: a free body's velocity u in the world is R^T u along its own axes."""
    joints = {joint.name: joint for joint in robot.joints}
    order = [joints[name] for name in robot.visuals.laws.start]  # in MuJoCo's order
    turns = {}
    for k, joint in enumerate(order):
        own, dof = q[joint.q], slice(model.jnt_dofadr[k], model.jnt_dofadr[k] + joint.v.stop - joint.v.start)
        at = model.jnt_qposadr[k]
        turn = np.eye(len(own[:6]) if len(own) == 7 else joint.v.stop - joint.v.start)
        if len(own) >= 4:
            own = np.array([*own[:-4], own[-1], *own[-4:-1]])
        if len(own) == 7:
            turn[:3, :3] = pin.Quaternion(*own[3:]).matrix()
        data.qpos[at : at + len(own)] = own
        data.qvel[dof], data.qfrc_applied[dof], turns[k] = turn @ v[joint.v], turn @ tau[joint.v], (dof, turn)
    mujoco.mj_forward(model, data)
    a = np.zeros(robot.nv)
    for k, joint in enumerate(order):
        dof, turn = turns[k]
        a[joint.v] = turn.T @ data.qacc[dof]
        if len(turn) == 6:
            a[joint.v][:3] -= np.cross(v[joint.v][3:], v[joint.v][:3])
    return a


def outcome(path: Path, given: Any) -> tuple[str, str]:
    """What came of a file, and the words for it."""
    try:
        if path.name.endswith(".urdf.xacro"):
            arguments = dict(pair.split("=", 1) for pair in given.arguments.split(",") if pair)
            robot = tl.load_robot(path, package_dirs=given.rest, xacro_arguments=arguments)
            return "loaded", f"nv = {robot.nv}, {robot.mass:.6g} kg"
        robot = tl.load_robot(path, unphysical="report")
        if robot.nv == 0:
            return "equal", "nothing moves"
        worst = difference(robot, smooth_mujoco(path), given.states)
        return "equal" if worst <= given.tolerance else "different", f"nv = {robot.nv}, worst {worst:.1e}"
    except TwolinkError as error:
        return ("no model" if error.code == "mjcf" else "refused"), str(error)
    except ValueError as error:  # of MuJoCo, which reads all meshes
        return "no model", f"MuJoCo: {' '.join(str(error).split())}"


def main() -> bool:
    """Print a line a file."""
    given, counts = options(__doc__, states=100, tolerance=1e-10, arguments="", rest=(".",)), Counter[str]()
    files = [path for folder in given.rest for path in Path(folder).rglob("*.x*")]
    for path in sorted(files):
        if path.name.endswith(".urdf.xacro") or (
                path.suffix == ".xml" and "<mujoco" in path.read_text("utf-8", "replace")):  # fmt: skip
            kind, words = outcome(path, given)
            counts[kind] += 1
            print(f"{kind:<10}{path}: {words}", flush=True)
    print(", ".join(f"{count} {kind}" for kind, count in counts.items()))
    return not counts["different"]


if __name__ == "__main__":
    sys.exit(not main())
