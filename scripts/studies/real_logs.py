"""Public logs of real robots, each with a run that is held out; and simulated ones, whose truth is known.

pendulum is here: runs 00, 02 and 04 of tests/parts/identification/double_pendulum, and run 12. The others are read
from the user's copy, as their licences do not allow ours or their files are large: a folder of `--logs` with a folder
for each, which holds the files that its function names.

panda: matlab/data/Exciting_Traj/Trajectory_1/rbt_log of github.com/marcocognetti/FrankaEmikaPandaDynModel (GPL 3; Gaz
et al., IEEE RA-L 4(4), 2019). ur10e: dataset_ur10e/identification_data and URe/urdf of
github.com/shamilmamedov/dynamic_calibration (no licence). tx40 and tiago: examples/staubli_TX40 and
examples/tiago/data/identification/dynamic, with their urdf, of github.com/thanhndv212/figaroh-examples. lbr_med: a
KUKA LBR Med 7 R700, src/test and urdf/med of github.com/lbr-stack/dynamic_parameter_identification (no licence).
pendulum_c: data/experiment_records/design_C.1/sys_id/20230629 and
data/system_identification/identified_parameters/design_C.1/model_1.1 of
github.com/dfki-ric-underactuated-lab/double_pendulum (BSD), each run as TIME.csv. simple:
results/control_method_NAME/data_measured.csv, each as NAME.csv, and data/urdf of
github.com/dfki-ric-underactuated-lab/torque_limited_simple_pendulum (BSD). icub_leg: the right leg of an iCub 3,
matlab/Datasets/traj_pos_control at commit 56b009a and code/matlab/ft_calibration/robots/iCubGenova09.urdf of
github.com/isorrentino/iCub-torque-control (no licence).
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import loadmat

import twolink as tl
from scripts.runner import TOP
from scripts.studies.intervals import DRIVES, recorded
from scripts.tasks import robot_of
from twolink.parts.identification.filtering import Recording

LOGS = TOP / "tests" / "parts" / "identification" / "double_pendulum"
PUBLISHED = {"Link1.first_moment.z": -0.5594 * 0.3, "Link1.origin_inertia.xx": 0.05347, "Link2.mass": 0.6043,
             "Link2.first_moment.z": 0.6043 * 0.1838, "Link2.origin_inertia.xx": 0.02392,
             **{f"Joint{k}.armature": 36 * 7.66e-5 for k in (1, 2)}, **{f"Joint{k}.damping": 0.001 for k in (1, 2)},
             "Joint1.friction": 0.093, "Joint2.friction": 0.078}  # fmt: skip
GAINS = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])  # N m/A, of the drives of a UR10e
RATIOS = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0]) + 32.0 * np.eye(6)[5][:, None] * np.eye(6)[4]  # of a TX40
# Currents by torques of a TIAGo's arm, N m/A: gear and motor constant.
TIAGO = {"arm_1_joint": 13.6, "arm_2_joint": 13.6, "arm_3_joint": -8.7, "arm_4_joint": -8.7,
         **dict.fromkeys(("arm_5_joint", "arm_6_joint", "arm_7_joint"), -20.6)}  # fmt: skip


@dataclass(frozen=True)
class Logs:
    """A robot, its runs, the one that is held out, and the parameters that were published; the filters, Hz."""

    robot: tl.Robot
    runs: list[Recording]
    held: Recording
    published: np.ndarray | None
    judged: float = 6.0
    fitted: float = 8.0


def named(robot: tl.Robot, values: dict[str, float]) -> np.ndarray:
    """Parameters of a robot in their order, 0 where there is no value."""
    return np.array([values.get(name, 0.0) for name in robot.parameter_names])


def divided(robot: tl.Robot, t: np.ndarray, q: np.ndarray, tau: np.ndarray, share: float = 0.7, **more: float) -> Logs:
    """One run, of which the later part is held out."""
    cut = int(share * len(t))
    fitted, held = (Recording(t[k], q[k], None, None, tau[k]) for k in (slice(cut), slice(cut, None)))
    return Logs(robot, [fitted], held, None, **more)


def numbers_in(path: Path) -> np.ndarray:
    """The numbers of a table with a line of names."""
    return np.loadtxt(path, delimiter=",", skiprows=1)


def pendulum(_: Path) -> Logs:
    def run(number: str) -> Recording:
        with np.load(LOGS / f"run_{number}.npz") as log:
            return Recording(log["t"], log["q"].astype(float), None, None, log["tau"].astype(float))

    robot = tl.load_robot(LOGS / "double_pendulum.urdf")
    return Logs(robot, [run(number) for number in ("00", "02", "04")], run("12"), named(robot, PUBLISHED))


def pendulum_c(folder: Path) -> Logs:
    """Another pair of links, 0.2 and 0.3 m long. Its model of friction, 0, is published for compensated friction."""

    def run(number: str) -> Recording:
        log = numbers_in(folder / f"{number}.csv")
        return Recording(log[:, 0], log[:, 1:3], None, None, log[:, 13:15])

    text = (folder / "acrobot.urdf").read_text()
    robot = tl.load_robot(re.sub(r'<joint name="base_weld".*?</joint>', "", text, flags=re.DOTALL), unphysical="report")
    runs = [run(number) for number in ("143339", "143524", "143704", "143747")]
    return Logs(robot, runs, run("143601"), robot.parameter_values)


def simple(folder: Path) -> Logs:
    """One joint. What its authors published, J = 0.063 kg m^2, is of other runs: these show 0.2.

    Not of its runs: gravity_compensation, where a hand moves it, and those whose torque no pendulum explains.
    """

    def run(name: str) -> Recording:
        log = numbers_in(folder / f"{name}.csv")
        return Recording(log[:, 0], log[:, 1:2], None, None, log[:, 3:4])

    robot = tl.load_robot(folder / "dfki_simple_pendulum.urdf")
    return Logs(robot, [run("direct_collocation"), run("ilqr")], run("ddp"), None)


def panda(folder: Path) -> Logs:
    read = {name: np.loadtxt(folder / f"exciting_traj_{name}.txt").reshape(-1, 7 if name != "time" else 1)[::4]
            for name in ("time", "positions", "torques")}  # fmt: skip
    t = read["time"][:, 0]
    new = np.append(True, np.diff(t) > 0)
    t, q, tau = t[new], read["positions"][new], read["torques"][new]
    fitted, held = (Recording(t[rows], q[rows], None, None, tau[rows]) for rows in (t < 14.0, t >= 14.0))
    robot = robot_of("panda")
    return Logs(robot, [fitted], held, robot.parameter_values)


def lbr_med(folder: Path) -> Logs:
    """Its torques have the opposite sign of the URDF's: `tl.identify` says so of joint A2."""
    log = numbers_in(folder / "measurements.csv")
    robot = tl.load_robot(folder / "med7dock.urdf", purpose="identification")
    return divided(robot, 0.01 * np.arange(len(log)), log[:, :7], -log[:, 7:14])


def ur10e(folder: Path) -> Logs:
    def run(name: str) -> Recording:
        log = np.loadtxt(folder / f"ur-20_02_{name}.csv", delimiter=",")
        log = log[np.append(True, np.diff(log[:, 0]) > 0)]
        return Recording(log[:, 0] - log[0, 0], log[:, 1:7], log[:, 7:13], None, log[:, 13:19] * GAINS)

    return Logs(tl.load_robot(folder / "ur10e.urdf"), [run("10-30sec_12harm")], run("12-40sec_12harm"), None, 10.0)


def tx40(folder: Path) -> Logs:
    turned, current = (numbers_in(folder / f"{name}_data.csv") for name in ("pos_read", "curr"))
    q, tau = turned @ np.linalg.inv(RATIOS).T + np.pi / 2 * np.array([0, -1, 1, 0, 0, 0]), current @ RATIOS
    robot = tl.load_robot(folder / "tx40_mdh_modified.urdf", purpose="identification")
    return divided(robot, 2e-4 * np.arange(len(q)), q, tau, judged=30.0, fitted=30.0)


def tiago(folder: Path) -> Logs:
    """The arm: currents times gear and motor constant. Its lift, whose effort is no force, moves slowly."""
    read = {name: numbers_in(folder / f"tiago_{name}.csv")[921:6791] for name in ("position", "effort")}
    options = {"purpose": "identification", "unphysical": "report"}
    whole = tl.load_robot(folder / "tiago_no_hand.urdf", **options)
    still = {j.name: [1.0, 0.0] if j.kind == "cos-sin" else 0.0 for j in whole.joints if j.name not in TIAGO}
    robot = tl.load_robot(folder / "tiago_no_hand.urdf", lock=still, **options)
    return divided(robot, read["position"][:, 0], read["position"][:, 2:], read["effort"][:, 2:] * [*TIAGO.values()])


def icub_leg(folder: Path) -> Logs:
    """Its torques are those of its force sensors and its own model. One path, and the same faster.

    Not of its runs: the two before, in which the knee's torques are not those of the leg's weight.
    """

    def run(time: str) -> Recording:
        log = loadmat(folder / f"ftimu_dataset_2021_08_03_{time}.mat", simplify_cells=True)
        t, state = log["time"], log["Joint_state"]
        return Recording(t - t[0], state["joint_positions"].T, None, None, state["joint_torques"].T)

    options = {"purpose": "identification", "unphysical": "report"}
    names = [joint.name for joint in tl.load_robot(folder / "iCubGenova09.urdf", **options).joints]
    leg = ("r_hip", "r_knee", "r_ankle")
    still = {name: 0.0 for name in names if not name.startswith(leg)}
    robot = tl.load_robot(folder / "iCubGenova09.urdf", lock=still, **options)
    return Logs(robot, [run("18_12_10")], run("18_14_03"), robot.parameter_values)


def twin(_: Path) -> Logs:
    """Two motions of a Panda with friction, delay, drift and quantised encoders and torques."""
    robot, logs = robot_of("panda"), [recorded("panda", np.random.default_rng(k), seed=k) for k in (0, 1)]
    fitted, held = (Recording(log["t"], log["q"], None, None, log["tau"]) for log in logs)
    known = zip(robot.parameter_names, robot.parameter_values, strict=True)
    truth = np.array([DRIVES.get(name.rpartition(".")[2], value) for name, value in known])
    return Logs(robot, [fitted], held, truth)


ROBOTS: dict[str, Callable[[Path], Logs]] = {
    each.__name__: each for each in (pendulum, pendulum_c, simple, panda, lbr_med, ur10e, tx40, tiago, icub_leg, twin)
}
