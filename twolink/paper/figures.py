"""The paper's figures 6 to 13 drawn again, and each of its claims answered with a number.

Black is the paper's hand-derived model (as corrected, twolink.lagrange). Grey is its "links oriented" model, here
URDF + Pinocchio. The paper gives no lengths and masses. With equal lengths and m1 : m2 = 3 : 1 its motion comes out.
Time scales with sqrt(l), so that the length alone decides whether a cycle takes 3 s or 0.75 s.

Source: S. N. H. Umar and E. Abu Bakar, "Study on Trajectory Motion and Computational Analysis of Robot Manipulator".
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twolink.dynamics import load_robot
from twolink.effects import Gravity
from twolink.lagrange import Variant, two_link
from twolink.lagrange.check import arm_urdf
from twolink.scenes import Scene
from twolink.show.figure import new_figure, save_figure
from twolink.simulation.scene_run import simulate

BLACK_LINE: dict[str, Any] = {"color": "0.0", "linewidth": 1.1, "label": "hand-derived"}
GREY_LINE: dict[str, Any] = {"color": "0.62", "linewidth": 3.2, "label": "URDF + Pinocchio"}
START = "#D55E00"
CYCLES = 3
SAMPLES = 400  # a cycle
TOLERANCE = 1e-12


@dataclass(frozen=True)
class ArmMotion:
    """Angles theta [rad] and speeds dtheta [rad/s] (n, 2) at times t (n,) [s]; both links are `length` [m] long."""

    t: np.ndarray
    theta: np.ndarray
    dtheta: np.ndarray
    length: float


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, whether it holds, and the numbers that decide."""

    text: str
    holds: bool
    found: str


@dataclass(frozen=True)
class PaperStudy:
    """The answered claims, the pictures, and the largest difference of the two models with equal parameters [rad]."""

    claims: tuple[Claim, ...]
    pictures: tuple[Path, ...]
    difference: float

    def text(self) -> str:
        """The claims and answers as plain text."""
        head = f"hand-derived against URDF + Pinocchio, same parameters: largest difference {self.difference:.1e} rad"
        lines = [f"  {'yes' if c.holds else 'NO ':<4}{c.text}\n        {c.found}" for c in self.claims]
        return "\n".join([head, *lines, *(f"drawn: {path}" for path in self.pictures)])


def by_hand(
    length: float, seconds: float, masses: tuple[float, float] = (3.0, 1.0), variant: Variant = "corrected"
) -> ArmMotion:
    """The hand-derived model, released at rest in the horizontal position."""
    from scipy.integrate import solve_ivp  # its import takes a third of a second

    model = two_link((length, length), masses, variant=variant)
    times = np.linspace(0, seconds, CYCLES * SAMPLES + 1)

    def rate(_t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[2:], model.forward_dynamics(x[:2], x[2:], np.zeros(2))])

    solution = solve_ivp(rate, (0, seconds), np.zeros(4), "DOP853", times, rtol=TOLERANCE, atol=TOLERANCE)
    return ArmMotion(times, solution.y[:2].T, solution.y[2:].T, length)


def by_urdf(length: float, seconds: float) -> ArmMotion:
    """The same release of the same arm, from a URDF through Pinocchio."""
    robot = load_robot(arm_urdf(length, length, 3.0, 1.0))
    scene = Scene(robot, effects=[Gravity()], duration=seconds)
    run = simulate(scene, accuracy=1e-9, samples_per_second=CYCLES * SAMPLES / seconds)
    if run.interrupted:
        raise KeyboardInterrupt
    return ArmMotion(run.t, run.q, run.v, length)


def cycle_time(motion: ArmMotion) -> float:
    """The time of the first cycle [s]: theta1 is at its highest again, where its speed crosses zero downwards."""
    w = motion.dtheta[:, 0]
    i = int(np.flatnonzero((w[:-1] > 0) & (w[1:] <= 0))[0])
    return float(motion.t[i] + w[i] / (w[i] - w[i + 1]) * (motion.t[i + 1] - motion.t[i]))


def study(out: Path) -> PaperStudy:
    """Simulate, answer the claims, and draw both sets of figures into the folder `out`."""
    period = cycle_time(by_hand(1.0, 4.0))  # of links of 1 m; it scales with the square root of the length
    hand, urdf = by_hand(1.0, CYCLES * period), by_urdf(1.0, CYCLES * period)
    slow, fast = by_hand((3.0 / period) ** 2, CYCLES * 3.0), by_urdf((0.75 / period) ** 2, CYCLES * 0.75)
    difference = float(np.abs(hand.theta - urdf.theta).max())
    same = f"Same parameters: l = 1 m, m = 3 and 1 kg. Largest difference {difference:.0e} rad"
    cycles = f"Cycles of 3 s (l = {slow.length:.3f} m) and 0.75 s (l = {fast.length:.4f} m)"
    pictures = (
        draw(hand, urdf, same, out / "paper-same-parameters.png"),
        draw(slow, fast, cycles, out / "paper-cycles-3s-and-0.75s.png"),
    )
    claims = (*angle_claims(hand, period), *speed_claims(hand), *cycle_claims(slow, fast), *mass_claims(hand))
    return PaperStudy(claims, pictures, difference)


def _sign_changes(values: np.ndarray) -> np.ndarray:
    """Indices before which the values change their sign; the first sample, at rest, does not count."""
    return np.flatnonzero(np.diff(np.sign(values[1:])) != 0) + 1


def angle_claims(motion: ArmMotion, period: float) -> list[Claim]:
    """The claims about the angles."""
    first, second = motion.theta.T
    top, bottom = first.max(), first.min()
    swings = abs(top) < 0.05 and abs(bottom + np.pi) < 0.05
    at_change = first[_sign_changes(second)]
    per_cycle = len(at_change) / (motion.t[-1] / period)
    changes = np.abs(at_change + np.pi / 2).max() < 0.1 and abs(per_cycle - 2) < 0.2
    where = f"{per_cycle:.2f} times a cycle, at theta1 between {at_change.min():.3f} and {at_change.max():.3f} rad"
    extremes = f"from {bottom:.4f} (-pi is {-np.pi:.4f}) to {top:.2e} rad"
    return [
        Claim("theta1 swings between 0 and -pi", bool(swings), extremes),
        Claim("theta1 stays below zero", bool(top <= 1e-9), f"highest {top:.2e} rad, the start itself"),
        Claim("theta2 changes sign when theta1 = -pi/2, twice a cycle", bool(changes), where),
    ]


def speed_claims(motion: ArmMotion) -> list[Claim]:
    """The claims about the speeds."""
    w1, w2 = motion.dtheta.T
    fastest = float(motion.theta[np.argmax(np.abs(w2)), 0])
    at_turning = float(np.abs(w2[_sign_changes(w1)]).max() / np.abs(w2).max())
    turning = f"where theta1 turns, at most {100 * at_turning:.1f} % of its largest"
    moving = (np.abs(w1) > 0.01 * np.abs(w1).max()) & (np.abs(w2) > 0.01 * np.abs(w2).max())
    opposed = float(np.mean(w1[moving] * w2[moving] < 0))
    share = f"they have opposite signs {100 * opposed:.0f} % of the time"
    place = f"largest at theta1 = {fastest:.3f} rad"
    return [
        Claim("the links' velocities oppose each other", opposed > 0.95, share),
        Claim("theta2's speed is largest at theta1 = -pi/2", abs(fastest + np.pi / 2) < 0.1, place),
        Claim("theta2's speed is small at theta1 = 0 and -pi (below 10 % of its largest)", at_turning < 0.1, turning),
    ]


def cycle_claims(slow: ArmMotion, fast: ArmMotion) -> list[Claim]:
    """The claims about the times of a cycle."""
    claims = []
    for paper_time, model, motion in ((3.0, "computerised", slow), (0.75, "links oriented", fast)):
        time = cycle_time(motion)
        answer = f"{time:.4f} s with links of {motion.length:.4f} m: the paper's models differ in their parameters"
        claims.append(Claim(f"one cycle takes {paper_time:g} s ({model})", abs(time / paper_time - 1) < 1e-3, answer))
    return claims


def mass_claims(hand: ArmMotion) -> list[Claim]:
    """What the paper leaves open: the masses and the C matrix that its figures can come from."""
    seconds = float(hand.t[-1])
    equal, printed = by_hand(1.0, seconds, (1.0, 1.0)), by_hand(1.0, seconds, variant="printed")
    near, far = recurrence(hand), recurrence(equal)
    right, wrong = (float(np.ptp(motion.theta[:, 1])) for motion in (hand, printed))
    back = "angles and speeds come back to within"
    sweep = f"the elbow then sweeps {wrong:.1f} rad instead of {right:.1f}: the figures come from the right matrix"
    unequal, even = "the motion nearly repeats with m1 : m2 = 3 : 1", "the motion nearly repeats with m1 : m2 = 1 : 1"
    return [
        Claim(unequal, near < 0.05, f"{back} {100 * near:.0f} % of their sweep"),
        Claim(even, far < 0.05, f"{back} {100 * far:.0f} % of their sweep at best"),
        Claim("the C matrix as printed gives this motion", abs(wrong / right - 1) < 0.1, sweep),
    ]


def recurrence(motion: ArmMotion) -> float:
    """How near the state comes to its start after a fifth of the time, as a part of the state's own range."""
    state = np.hstack([motion.theta, motion.dtheta * np.sqrt(motion.length / 9.81)])
    late = motion.t > motion.t[-1] / 5
    return float(np.abs(state[late]).max(axis=1).min() / np.ptp(state, axis=0).max())


def draw(black: ArmMotion, grey: ArmMotion, title: str, path: Path) -> Path:
    """Figures 6 to 13 on one sheet: angles and speeds over time, and the phase plots of both models."""
    figure, axes = new_figure(4, 2, size=(11, 13))
    for i, axis in enumerate(axes.flat[:4]):
        link, speeds = i % 2, i >= 2
        for motion, style in ((grey, GREY_LINE), (black, BLACK_LINE)):
            axis.plot(motion.t, (motion.dtheta if speeds else motion.theta)[:, link], **style)
        ylabel = f"theta{link + 1}' (rad/s)" if speeds else f"theta{link + 1} (rad)"
        quantity = "speed" if speeds else "angle"
        axis.set(title=f"Fig. {6 + i}: {quantity} of link {link + 1}, both models", xlabel="time t (s)", ylabel=ylabel)
    for i, axis in enumerate(axes.flat[4:]):
        link, (motion, style) = i % 2, (black, BLACK_LINE) if i < 2 else (grey, GREY_LINE)
        theta, speed = motion.theta[:, link], motion.dtheta[:, link]
        axis.plot(theta, speed, color=style["color"], linewidth=1.3)
        axis.plot(theta[0], speed[0], "o", color=START, markersize=6, label="start")
        axis.set(title=f"Fig. {10 + i}: phase plot of link {link + 1}, {style['label']}")
        axis.set(xlabel=f"theta{link + 1} (rad)", ylabel=f"theta{link + 1}' (rad/s)")
    handles = [*axes[0, 0].get_lines()[::-1], axes[2, 0].get_lines()[1]]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(title)
    return save_figure(figure, path)
