"""The paper's statements about its equations and methods (abstract, sections 1, 2 and 4), each with its number."""

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from twolink.dynamics import Robot, load_robot
from twolink.lagrange import two_link
from twolink.lagrange.check import arm_urdf
from twolink.lagrange.derive import compare
from twolink.paper.claims import Claim
from twolink.paper.motions import MASSES, ArmMotion, by_hand
from twolink.paper.ode45 import DefaultsStudy

STATES, CALLS = 200, 2000
LENGTH = 1.0  # m
BESIDE = 1e-9  # rad: a release beside the paper's


def model_claims(hand: ArmMotion, difference: float, defaults: DefaultsStudy) -> tuple[Claim, ...]:
    """All of it. difference: of the two models with the same parameters [rad]."""
    return (*equation_claims(), *formulation_claims(), *solving_claims(defaults), *conclusions(hand, difference))


def equation_claims() -> list[Claim]:
    """Section 2.1: the equations against SymPy's derivation and Pinocchio."""
    robot = load_robot(arm_urdf(LENGTH, LENGTH, *MASSES))
    arm, printed = (two_link((LENGTH, LENGTH), MASSES, variant=name) for name in ("corrected", "printed"))
    q, v = np.random.default_rng(0).uniform(-3.0, 3.0, (2, STATES, 2))
    inertia = float(np.abs(robot.mass_matrix(q) - arm.A(q)).max())
    gravity = float(np.abs(robot.bias(q, 0.0 * v) - arm.D(q)).max())
    off = float(np.abs(robot.bias(q, v) - printed.bias(q, v)).max())
    wrong = [name for name, (_, entry) in compare().items() if str(entry) != "0"]
    rod, elbow = robot.model.inertias[2].inertia[1, 1], float(arm.A([0.0, 0.0])[1, 1])
    length2 = MASSES[1] * LENGTH**2
    still = np.array([0.0, 1.0])  # link 1 at rest, link 2 turning
    alone = float(np.abs(arm.bias(q, still) - arm.D(q) - arm.C(q) @ still**2).max())
    return [
        Claim("two links with two revolute joints have two degrees of freedom", robot.nv == 2, f"nq = {robot.nq}, nv = "
              f"{robot.nv}", "section 2.1"),
        Claim("the kinetic energy has theta''", False, "I theta''^2 is in kg m^2/s^4, no energy; it is theta'^2",
              "eq. 2"),
        Claim("the potential energy has m1 and cosines for both links", False,
              "angles are from the horizontal: a height is a sine, and D follows from m_i and sines alone", "eq. 3"),
        Claim("the moment of inertia of a link is m l^2/2", bool(np.isclose(rod, length2 / 2)),
              f"{rod / length2:.4f} m l^2 = m l^2/12 about its centre, so that A22 = {elbow / length2:.4f} m l^2 as in "
              "eq. 11; m l^2/2 would make it 3/4", "eq. 4"),
        Claim("A is the inertia matrix", inertia < 1e-12,
              f"equals Pinocchio's at {STATES} states to {inertia:.0e} kg m^2", "eqs. 7 to 11"),
        Claim("B is centripetal and C Coriolis", False, "B multiplies products of speeds (Coriolis), C squares "
              "(centripetal)", "eqs. 12 to 18"),
        Claim("Coriolis torques are there because link one is a rotating frame for link two", alone < 1e-12,
              f"with link one at rest they are {alone:.0e} N m at {STATES} states", "section 2.1"),
        Claim("C is right as printed", not wrong, f"{' and '.join(wrong)} differ from SymPy's derivation; torques "
              f"from Pinocchio's by up to {off:.1f} N m: C21 = -C12, C22 = 0", "eqs. 16 to 18"),
        Claim("D is the torque of gravity", gravity < 1e-12,
              f"equals Pinocchio's to {gravity:.0e} N m", "eqs. 19 to 21"),
        Claim("Table 1 names the symbols", False, "its rows are shifted by one, from theta2 on", "Table 1"),
    ]  # fmt: skip


def formulation_claims() -> list[Claim]:
    """Section 1: Newton-Euler against Lagrange, forward against inverse dynamics."""
    texts, same = [], 0.0
    for robot in map(load_robot, ("two_link", "panda", "talos")):
        one, other, apart = _both(robot)
        same = max(same, apart)
        texts.append(f"{robot.name}, {robot.nv} joints: {1e6 * one:.1f} and {1e6 * other:.1f} us")
    robot = load_robot("two_link")
    q, v, tau = np.random.default_rng(1).uniform(-3.0, 3.0, (3, STATES, 2))
    back = float(np.abs(robot.inverse_dynamics(q, v, robot.forward_dynamics(q, v, tau)) - tau).max())
    return [
        Claim("nothing shows that Newton-Euler or Lagrange is better", False,
              f"the same torques to {same:.0e} (relative), at a different price: RNEA, and the matrices of "
              f"Lagrange alone: {'; '.join(texts)}. RNEA's work grows with the joints of a chain, that of the matrices "
              "with their square",
              "section 1"),
        Claim("forward dynamics gives the motion of torques, inverse dynamics the torques of a motion", back < 1e-9,
              f"one after the other gives the torques back to {back:.0e} N m", "section 1"),
    ]  # fmt: skip


def _both(robot: Robot) -> tuple[float, float, float]:
    """Seconds of Newton-Euler and of Lagrange's matrices (not multiplied) for a state; how far torques are apart."""
    model, data = robot.model, robot.model.createData()
    q, v = (one[0] for one in robot.random_state(1, seed=0))
    a = np.random.default_rng(2).uniform(-1.0, 1.0, robot.nv)

    def by_links() -> np.ndarray:
        return np.asarray(pin.rnea(model, data, q, v, a))

    def matrices() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        inertia, coriolis = pin.crba(model, data, q), pin.computeCoriolisMatrix(model, data, q, v)
        return inertia, coriolis, pin.computeGeneralizedGravity(model, data, q)

    torque = by_links().copy()
    inertia, coriolis, gravity = matrices()
    apart = float(np.abs(inertia @ a + coriolis @ v + gravity - torque).max() / np.abs(torque).max())
    return _seconds(by_links), _seconds(matrices), apart


def _seconds(call: Callable[[], object]) -> float:
    """The least seconds a call, of five rounds."""
    rounds = []
    for _ in range(5):
        begin = time.perf_counter()
        for _ in range(CALLS // 5):
            call()
        rounds.append((time.perf_counter() - begin) / (CALLS // 5))
    return min(rounds)


def solving_claims(study: DefaultsStudy) -> list[Claim]:
    """Section 2.2: the equations cannot be solved in closed form, and ode45 solves them."""
    one, other = by_hand(LENGTH, 30.0, (1.0, 1.0)), by_hand(LENGTH, 30.0, (1.0 + BESIDE, 1.0))
    grown = float(np.abs(one.theta - other.theta).max())
    first, second = study.off[-1]
    cheap, best = study.pair[0], study.verified[-1]
    reached = next(row for row in study.pair if row.largest < best.setting)
    return [
        Claim("the equations are highly nonlinear, with no solution in closed form", None,
              "no number decides it, but one shows how nonlinear they are: "
              f"with m1 : m2 = 1 : 1 a mass that differs by {BESIDE:.0e} moves the links by {grown:.1g} rad in 30 s",
              "section 2.2"),
        Claim("ode45 takes equations of first and of second order", False,
              "of first order: eq. 22 becomes 4 of them, theta' = w, w' = A^-1 (T - h - gamma)", "section 2.2"),
        Claim("ode45 at its defaults draws these curves right", bool(study.off.max() < 1e-3),
              f"after three cycles theta1 is off by {first:.1e} and theta2 by {second:.1e} rad, on the way by up to "
              f"{study.off[:, 0].max():.1e} and {study.off[:, 1].max():.1e} rad (rtol 1e-3, atol 1e-6, "
              f"{1e3 * cheap.seconds:.0f} ms by SciPy's RK45, whose step control differs in details); to "
              f"{best.setting:.0e} rad it takes rtol {reached.setting:.0e} and {1e3 * reached.seconds:.0f} ms; "
              f"tl.simulate takes {1e3 * best.seconds:.1f} ms with an error bar of {best.bar:.0e} rad, after tracing "
              f"once ({best.compile_seconds:.1g} s here)", "section 2.2"),
    ]  # fmt: skip


def conclusions(hand: ArmMotion, difference: float) -> list[Claim]:
    """The abstract and section 4."""
    kinetic, potential = hand.link_energies()
    energy = (kinetic + potential).sum(axis=1)
    drift = float(np.ptp(energy) / kinetic.max())
    return [
        Claim("the derived and the SimMechanics model give the identical simulation", difference < 1e-8,
              f"with the same parameters to {difference:.0e} rad, here by URDF + Pinocchio; the paper's two runs "
              "differ four times in frequency, since their parameters do", "section 4"),
        Claim("both methods satisfy the principle of a two-link manipulator", drift < 1e-9,
              f"energy is constant to {drift:.0e} of the largest kinetic one", "section 4"),
        Claim("the relation between both links decides the performance of pitching and bowling", None,
              "`twolink throw` answers it: a pitch goes farthest at 35.0 degrees, not at 45, by the release times "
              "of ball and elbow, and it says what a millisecond costs", "abstract"),
        Claim("SimMechanics is convenient where deriving the equations is cumbersome", None,
              "an opinion; a URDF needs no derivation either", "section 4"),
    ]  # fmt: skip
