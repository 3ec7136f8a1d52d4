"""Others' cases with exact solutions or published numbers: errors, bars and seconds beside what was published.

IFToMM library of computational benchmark problems (Gonzalez et al. 2006): A01 to A04. Test Set for IVP Solvers (Mazzia,
Magherini 2008), problem andrews. SUNDIALS 7, idaSlCrank_dns. NASA NESC check case 2 (NASA/TM-2015-218675; time
histories in github.com/nasa/simupy-flight, NESC_data). Newton's verification scenes (newton-physics/newton,
newton/tests/test_physics_verification.py at 41a5392c1, and from its free fall to its four-bar at 00b6b3d62): their
bounds are what its solvers must keep.
"""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import ellipj, ellipk

import twolink as tl
from scripts.runner import Table, once
from scripts.studies.scenes.robots import body, free_robot, robot_of

E = tl.effects
Run = Callable[..., tl.Trajectory]
DEGREE = np.pi / 180.0
ROWS = 2001  # of a result
# Body rates about x, y, z after 30 s, deg/s, by five tools of check case 2 (its files sim_01, 02, 04, 05, 06).
NESC = ((12.61839077566776, -17.3974747618308, 31.11958888682995),
        (12.619216961385067, -17.396709626714614, 31.119942061280724),
        (12.6183907757, -17.3974747619, 31.1195888868),
        (12.618423766019587, -17.397444101295715, 31.11960300607054),
        (12.620844062702608, -17.394550197091117, 31.12073831148526))  # fmt: skip


class Case(NamedTuple):
    """A case: where it is from, and what is compared; a run, its error, and what was published, in words."""

    name: str
    what: str
    run: Run
    error: Callable[[tl.Trajectory], float]
    published: str


def point_pendulum(angle: float, g: float, length: float = 1.0) -> tl.Scene:
    """A point of 1 kg on a rod without mass, let go from an angle to the downward vertical, rad."""
    text = f"""<link name="rod"><inertial><origin xyz="0 0 {-length}"/><mass value="1"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="ground"/><child link="rod"/><axis xyz="0 -1 0"/></joint>"""
    return tl.Scene(robot_of(text, "ground"), [np.cos(angle), np.sin(angle)], effects=[E.Gravity((0.0, 0.0, -g))])


def off_the_ellipse(run: tl.Trajectory, angle: float, w0: float) -> float:
    """The largest error of a pendulum's angle: 2 asin(k sn(K - w0 t, k)), k = sin(angle / 2)."""
    k = np.sin(0.5 * angle)
    exact = 2.0 * np.arcsin(k * ellipj(ellipk(k * k) - w0 * run.t, k * k)[0])
    return float(np.abs(np.arctan2(run.q[:, 1], run.q[:, 0]) - exact).max())


def places(run: tl.Trajectory, frame: str) -> np.ndarray:
    """Where a frame is at each sample (n, 3), m."""
    return np.array([run.robot.frame_pose(q, frame)[1] for q in run.q])


def write_results(folder: Path) -> None:
    """Write what IFToMM's library asks for as text files: a row a sample, of the time and the result."""
    folder.mkdir(parents=True, exist_ok=True)
    for case in cases():
        name = case.name.split(",")[0]
        if name in RESULTS:
            run = case.run(t_eval=np.linspace(0.0, case.run().t[-1], ROWS))
            columns = {"t": run.t, **RESULTS[name](run)}
            place = folder / f"{name.replace(' ', '_')}.txt"
            np.savetxt(place, np.column_stack(list(columns.values())), "%.12e", header=" ".join(columns))
            print(place)


def at_end(expected: dict[str, float], run: tl.Trajectory) -> float:
    """The largest error of columns at the end."""
    return max(abs(run.columns()[name][-1] - value) for name, value in expected.items())


def four_bar(run: tl.Trajectory) -> float:
    """Of the point B0: the mechanism is a compound pendulum."""
    left = run.columns()["q.left"][-1]
    return float(np.hypot(np.cos(left) - 0.32845811154081538, np.sin(left) - 0.94451853817860096))


def energy_drift(run: tl.Trajectory) -> float:
    return float(np.ptp(run.energy))


def brick() -> tl.Scene:
    """The NESC's brick, whose spin does not depend on where it is: moments of inertia in slug ft^2, deg/s."""
    moments = (0.00189422, 0.006211019, 0.007194665)
    scale = 14.593902937 * 0.3048**2
    robot = free_robot(("brick", 0.155404754 * 14.593902937, tuple(scale * one for one in moments)))
    return tl.Scene(robot, [0, 0, 0, 0, 0, 0, 1], [0, 0, 0, *(DEGREE * np.array([10.0, 20.0, 30.0]))])


def off_the_nearest_tool(run: tl.Trajectory) -> float:
    """Of the body rates, in deg/s, to the nearest of the tools."""
    return min(float(np.abs(run.v[-1, 3:] / DEGREE - one).max()) for one in NESC)


def others_differ() -> list[float]:
    """The differences in deg/s, the largest first, of the tools that are not with the one of 12 digits."""
    off = np.abs(np.array(NESC) - NESC[2]).max(axis=1)
    return sorted(off[off > 1e-8].tolist(), reverse=True)


def momentum_drift(run: tl.Trajectory) -> float:
    """The relative drift of the angular momentum in the world."""
    inertia = run.robot.model.inertias[1].inertia
    found = np.array([run.robot.frame_pose(q, "body")[0] @ inertia @ v[3:] for q, v in zip(run.q, run.v, strict=True)])
    return float(np.abs(found - found[0]).max() / np.linalg.norm(found[0]))


def thrown(height: float, velocity: tuple[float, float, float]) -> tl.Scene:
    """A body let go or thrown at a height, m; velocity: m/s, z upward."""
    robot = free_robot(("ball", 1.0, (1e-3,) * 3))
    return tl.Scene(robot, [0, 0, height, 0, 0, 0, 1], [*velocity, 0, 0, 0], [E.Gravity((0.0, 0.0, -10.0))])


def off_the_parabola(run: tl.Trajectory) -> float:
    """Of the place at all samples, m."""
    start, speed = run.q[0, :3], run.v[0, :3]
    exact = start + np.outer(run.t, speed) + np.outer(0.5 * run.t**2, [0.0, 0.0, -10.0])
    return float(np.abs(run.q[:, :3] - exact).max())


BLOCK, BALL = 64.0 * (0.4**2 + 0.4**2) / 12.0, 1000.0 * 4.0 / 3.0 * np.pi * 0.1**3  # kg m^2 and kg, of 1,000 kg/m^3


def driven() -> tl.Scene:
    """A box on a hinge and a ball on a slide, driven by 5 N m and 5 N."""
    parts = (body("box", 64.0, BLOCK, "revolute", "hinge") +
             body("ball", BALL, 1e-3, "prismatic", "slide", axis="1 0 0", at="0 5 0"))  # fmt: skip
    return tl.Scene(robot_of(parts), effects=[E.Torque({"hinge": 5.0, "slide": 5.0})])


def off_the_speeds(run: tl.Trajectory) -> float:
    """Of both speeds at the end, relative."""
    speeds = {"v.hinge": 5.0 * run.t[-1] / BLOCK, "v.slide": 5.0 * run.t[-1] / BALL}
    return max(abs(run.columns()[name][-1] / speed - 1.0) for name, speed in speeds.items())


CRANK, COUPLER, ROCKER, GROUND = 0.2, 0.5, 0.4, 0.5  # m, of Newton's four-bar


def rocker_angle(crank: np.ndarray) -> np.ndarray:
    """The angle of the rocker from that of the crank: K1 cos r - K2 cos c + K3 = cos(c - r) (Freudenstein)."""
    a = GROUND / CRANK - np.cos(crank)
    b = -np.sin(crank)
    rest = (CRANK**2 - COUPLER**2 + ROCKER**2 + GROUND**2) / (2.0 * CRANK * ROCKER)
    return np.asarray(np.arctan2(b, a) + np.arccos((GROUND / ROCKER * np.cos(crank) - rest) / np.hypot(a, b)))


def crank_rocker() -> tl.Scene:
    """Four bars of 1,000 kg/m^3, 4 cm by 4 cm, whose crank is driven to a turn a second by 100 N m s/rad."""
    parts, parent, at = "", "world", 0.0
    for name, length in (("crank", CRANK), ("coupler", COUPLER), ("rocker", ROCKER)):
        mass = 1.6 * length
        parts += body(name, mass, mass * (length**2 + 0.04**2) / 12.0, "revolute", f"{name}_joint", parent=parent,
                      com=f"{length / 2} 0 0", at=f"{at} 0 0")  # fmt: skip
        parent, at = name, length
    end = GROUND + ROCKER * np.exp(1j * rocker_angle(np.zeros(1))[0])
    coupler, rocker = np.angle(end - CRANK), np.angle(GROUND - end)
    effects = [E.Torque({"crank_joint": 100.0 * 2.0 * np.pi}), E.JointDamping({"crank_joint": 100.0}),
               E.PointLoop("rocker", point_a=(ROCKER, 0.0, 0.0), point_b=(GROUND, 0.0, 0.0))]  # fmt: skip
    return tl.Scene(robot_of(parts), [0.0, coupler, rocker - coupler], effects=effects)


def off_freudenstein(run: tl.Trajectory) -> float:
    """Of the rocker's angle, rad."""
    ends = places(run, "rocker")
    off = np.arctan2(ends[:, 1], ends[:, 0] - GROUND) - rocker_angle(run.q[:, 0])
    return float(np.abs((off + np.pi) % (2.0 * np.pi) - np.pi).max())


def ball(restitution: float) -> tl.Scene:
    robot = free_robot(("ball", 1.0, (1e-3,) * 3))
    contact = E.Contact(("ground",), 0.0, restitution=restitution, shapes={"ball": (E.Sphere(0.05),)})
    return tl.Scene(robot, [0, 0, 1.05, 0, 0, 0, 1], effects=[E.Gravity((0.0, 0.0, -10.0)), contact])


def off_the_rebound(restitution: float, run: tl.Trajectory) -> float:
    """Of the height of the rebound, relative: e^2 of the fall, h^2 e^2 / h."""
    fall = np.sqrt(2.0 * 1.0 / 10.0)
    top = float(run.at(fall * (1.0 + restitution))[0][2]) - 0.05
    return abs(top / restitution**2 - 1.0)


ANDREWS = {"q.beta": 15.8107711951537, "q.theta": -15.7563710584118, "q.gamma": 0.0408222401196458,
           "q.phi": -0.534730116342080, "q.delta": 0.524409965879954, "q.epsilon": 1.04808074104194}  # fmt: skip
SLIDER_CRANK = {"q.crank_joint": 1.27567584865024, "q.slide": 1.02357855897984, "v.crank_joint": -0.23991499719600}
# What IFToMM's library asks for at each sample: the places of P1, B0 and P3, m, with y upward; the angles, rad.
RESULTS: dict[str, Callable[[tl.Trajectory], dict[str, np.ndarray]]] = {
    "IFToMM A01": lambda run: {"x": run.q[:, 1], "y": -run.q[:, 0]},
    "IFToMM A02": lambda run: {"x": np.cos(run.columns()["q.left"]), "y": np.sin(run.columns()["q.left"])},
    "IFToMM A03": lambda run: {name.removeprefix("q."): run.columns()[name] for name in ANDREWS},
    "IFToMM A04": lambda run: dict(zip("xyz", places(run, "rod4").T, strict=True)),
}


def bundled(name: str, accuracy: float) -> Run:
    return partial(tl.simulate, tl.load_scene(name), accuracy=accuracy)


def cases() -> list[Case]:
    """All of them."""
    spin = free_robot(("body", 1.0, (0.2, 0.5, 0.4)))
    spinning = tl.Scene(spin, [0, 0, 0, 0, 0, 0, 1], [0, 0, 0, 0.7, -0.5, 0.9])
    level, small, bounces = 0.5 * np.pi, 0.05, "1 % (bound of the test)"
    return [
        Case("IFToMM A01", "pendulum from the level, 10 s: angle",
             partial(tl.simulate, point_pendulum(level, 9.81), 10.0, accuracy=1e-9),
             partial(off_the_ellipse, angle=level, w0=np.sqrt(9.81)), "exact, by elliptic functions"),
        Case("IFToMM A02", "two four-bars through singular positions, 10 s: place of B0",
             bundled("four-bar", 1e-6), four_bar, "4.7e-5 with 1 ms, 7.3e-7 with 0.125 ms"),
        Case("IFToMM A03, IVP test set", "Andrews' squeezer, 30 ms: angles", bundled("squeezer", 1e-10),
             partial(at_end, ANDREWS), "reference good to 7e-11"),
        Case("IFToMM A04", "Bricard's mechanism, 10 s: energy, J", bundled("bricard", 1e-9), energy_drift,
             "0, for nothing dissipates"),
        Case("SUNDIALS", "slider-crank of idaSlCrank_dns, 10 s: q and its rate", bundled("crank-spring", 1e-9),
             partial(at_end, SLIDER_CRANK), "3 digits"),
        Case("NASA NESC 2", "tumbling brick, 30 s: body rates, deg/s, to the nearest tool",
             partial(tl.simulate, brick(), 30.0, accuracy=1e-11), off_the_nearest_tool,
             f"others differ by {', '.join(f'{off:.1e}' for off in others_differ())}"),
        Case("Newton, pendulum", "small swing, 3.5 periods: angle",
             partial(tl.simulate, point_pendulum(small, 10.0), 3.5 * 2.0 * np.pi / np.sqrt(10.0), accuracy=1e-9),
             partial(off_the_ellipse, angle=small, w0=np.sqrt(10.0)), "5e-4 (bound of the test, 1 %)"),
        Case("Newton, free body", "precession, 10 s: angular momentum, relative",
             partial(tl.simulate, spinning, 10.0, accuracy=1e-9), momentum_drift, "5e-3 (bound of the test)"),
        Case("Newton, free fall", "5 m, 0.5 s: place, m", partial(tl.simulate, thrown(5.0, (0, 0, 0)), 0.5),
             off_the_parabola, "5e-3 (bound of the test)"),
        Case("Newton, projectile", "5 and 10 m/s, 0.1 s: place, m", partial(tl.simulate, thrown(10.0, (5, 0, 10)), 0.1),
             off_the_parabola, "1e-3 (bound of the test)"),
        Case("Newton, energy", "pendulum from 1 rad, 2 s: energy, J",
             partial(tl.simulate, point_pendulum(1.0, 10.0), 2.0, accuracy=1e-9), energy_drift,
             "0.5 % (bound of the test)"),
        Case("Newton, driven joints", "5 N m and 5 N, 0.3 s: speeds, relative", partial(tl.simulate, driven(), 0.3),
             off_the_speeds, "one step of 1 ms (bound of the test)"),
        Case("Newton, four-bar", "two turns of the crank: the rocker's angle by Freudenstein's equation",
             partial(tl.simulate, crank_rocker(), 2.0, accuracy=1e-9), off_freudenstein, "1.7e-3 (bound of the test)"),
        *(Case(f"Newton, restitution {e:g}", "height of the rebound, relative",
               partial(tl.simulate, ball(e), 1.0, accuracy=1e-9), partial(off_the_rebound, e), bounces)
          for e in (0.5, 0.8)),
    ]  # fmt: skip


def compare() -> Table:
    """The table of all cases."""
    table = Table("source <26 | case <66 | error >8.1e | bar >8.1e | s >7.3f | published <1")
    for case in cases():
        taken, run = once(case.run, time.process_time)
        bar = float("nan") if run.error is None else float(run.error.max())
        table.add(case.name, case.what, case.error(run), bar, taken, case.published)
    return table
