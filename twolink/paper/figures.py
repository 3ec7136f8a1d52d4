"""The paper's figures 6 to 13 drawn again, and each of its claims computed and answered.

S. N. H. Umar and E. Abu Bakar, "Study on Trajectory Motion and Computational Analysis of Robot Manipulator". Black is
its hand-derived model (as corrected, twolink.lagrange), grey the "links oriented" model, here URDF + Pinocchio.
The paper gives no lengths and masses: with equal lengths and m1 : m2 = 3 : 1 its motion comes out, and since time
scales with sqrt(l), a cycle of 3 s or 0.75 s is a matter of length alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twolink.dynamics import load_robot
from twolink.effects import Gravity
from twolink.lagrange import Variant, two_link
from twolink.lagrange.pinocchio_arm import arm_urdf
from twolink.scenes import Scene
from twolink.show.figure import new_figure, save_figure
from twolink.simulation.scene_run import simulate

BLACK, GREY = "0.0", "0.62"
CYCLES = 3
SAMPLES = 400  # a cycle
TOLERANCE = 1e-12


@dataclass(frozen=True)
class Motion:
    """theta, dtheta (n, 2) at times t (n,), of an arm with both links `length` long."""

    t: np.ndarray
    theta: np.ndarray
    dtheta: np.ndarray
    length: float


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, whether it holds, and the number that says so."""

    text: str
    holds: bool
    found: str


@dataclass(frozen=True)
class PaperStudy:
    """Claims answered, pictures drawn, and the largest difference of the two models with the same parameters."""

    claims: tuple[Claim, ...]
    pictures: tuple[Path, ...]
    difference: float

    def text(self) -> str:
        """The claims and answers as plain text."""
        lines = [
            f"hand-derived against URDF + Pinocchio, same parameters: largest difference {self.difference:.1e} rad"
        ]
        lines += [f"  {'yes' if c.holds else 'NO ':<4}{c.text}\n        {c.found}" for c in self.claims]
        return "\n".join([*lines, *(f"drawn: {p}" for p in self.pictures)])


def by_hand(
    length: float, seconds: float, masses: tuple[float, float] = (3.0, 1.0), variant: Variant = "corrected"
) -> Motion:
    """The hand-derived model released from horizontal rest."""
    model = two_link((length, length), masses, variant=variant)
    times = np.linspace(0, seconds, int(CYCLES * SAMPLES) + 1)
    rest = np.zeros(2)

    def rate(_t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[2:], model.forward_dynamics(x[:2], x[2:], rest)])

    from scipy.integrate import solve_ivp  # its import takes a third of a second

    found = solve_ivp(rate, (0, seconds), np.zeros(4), "DOP853", times, rtol=TOLERANCE, atol=TOLERANCE)
    return Motion(times, found.y[:2].T, found.y[2:].T, length)


def by_urdf(length: float, seconds: float) -> Motion:
    """The same release, from a URDF by way of Pinocchio."""
    robot = load_robot(arm_urdf(length, length, 3.0, 1.0))
    scene = Scene(robot, effects=[Gravity()], duration=seconds)
    run = simulate(scene, accuracy=1e-9, samples=CYCLES * SAMPLES / seconds)
    return Motion(run.t, run.q, run.v, length)


def cycle(motion: Motion) -> float:
    """The time of the first cycle: when theta1 is back at its highest, its speed crossing zero downwards [s]."""
    w = motion.dtheta[:, 0]
    back = np.flatnonzero((w[:-1] > 0) & (w[1:] <= 0))
    i = int(back[0])
    return float(motion.t[i] + w[i] / (w[i] - w[i + 1]) * (motion.t[i + 1] - motion.t[i]))


def study(out: Path) -> PaperStudy:
    """Simulate, answer the claims and draw both sets of figures into the folder `out`."""
    period = cycle(by_hand(1.0, 4.0))  # at 1 m; time scales with the root of the length
    seconds = CYCLES * period
    hand, urdf = by_hand(1.0, seconds), by_urdf(1.0, seconds)
    difference = float(np.abs(hand.theta - urdf.theta).max())
    lengths = [(wanted / period) ** 2 for wanted in (3.0, 0.75)]
    slow, fast = by_hand(lengths[0], CYCLES * 3.0), by_urdf(lengths[1], CYCLES * 0.75)
    pictures = (
        draw(
            hand,
            urdf,
            f"Same parameters: l = 1 m, m = 3 and 1 kg. Largest difference {difference:.0e} rad",
            out / "paper-same-parameters.png",
        ),
        draw(
            slow,
            fast,
            f"Cycles of 3 s (l = {slow.length:.3f} m) and 0.75 s (l = {fast.length:.4f} m)",
            out / "paper-cycles-3s-and-0.75s.png",
        ),
    )
    return PaperStudy((*claims(hand, period), *cycle_claims(slow, fast), *mass_claims(hand)), pictures, difference)


def claims(motion: Motion, period: float) -> list[Claim]:
    """The claims about the shape of the motion."""
    first, second = motion.theta.T
    w1, w2 = motion.dtheta.T
    top, bottom = first.max(), first.min()
    change = np.flatnonzero(np.diff(np.sign(second[1:])) != 0) + 1
    at_change = first[change]
    per_cycle = len(change) / (motion.t[-1] / period)
    fastest = float(first[np.argmax(np.abs(w2))])
    turning = np.flatnonzero(np.diff(np.sign(w1[1:])) != 0) + 1
    at_turning = np.abs(w2[turning]).max() / np.abs(w2).max()
    moving = (np.abs(w1) > 0.01 * np.abs(w1).max()) & (np.abs(w2) > 0.01 * np.abs(w2).max())
    opposed = float(np.mean(w1[moving] * w2[moving] < 0))
    half = np.pi / 2
    return [
        Claim(
            "theta1 swings between 0 and -pi",
            abs(top) < 0.05 and abs(bottom + np.pi) < 0.05,
            f"from {bottom:.4f} (-pi is {-np.pi:.4f}) to {top:.2e} rad",
        ),
        Claim("theta1 stays below zero", bool(top <= 1e-9), f"highest {top:.2e} rad, the start itself"),
        Claim(
            "theta2 changes sign when theta1 = -pi/2, twice a cycle",
            bool(np.abs(at_change + half).max() < 0.1 and abs(per_cycle - 2) < 0.2),
            f"{per_cycle:.2f} times a cycle, at theta1 between {at_change.min():.3f} and {at_change.max():.3f} rad",
        ),
        Claim(
            "the links' velocities oppose each other",
            opposed > 0.95,
            f"they have opposite signs {100 * opposed:.0f} % of the time",
        ),
        Claim(
            "theta2's speed is largest at theta1 = -pi/2",
            abs(fastest + half) < 0.1,
            f"largest at theta1 = {fastest:.3f} rad",
        ),
        Claim(
            "theta2's speed is small at theta1 = 0 and -pi (below 10 % of its largest)",
            bool(at_turning < 0.1),
            f"where theta1 turns, at most {100 * at_turning:.1f} % of its largest",
        ),
    ]


def cycle_claims(slow: Motion, fast: Motion) -> list[Claim]:
    """The claims about the cycles' times."""
    found = [cycle(slow), cycle(fast)]
    return [
        Claim(
            f"one cycle takes {wanted:g} s ({who})",
            abs(got / wanted - 1) < 1e-3,
            f"{got:.4f} s with links of {motion.length:.4f} m: the paper's models differ in their parameters",
        )
        for wanted, who, got, motion in (
            (3.0, "computerised", found[0], slow),
            (0.75, "links oriented", found[1], fast),
        )
    ]


def mass_claims(hand: Motion) -> list[Claim]:
    """What the paper does not say: which masses, and which C matrix, its figures can come from."""

    def recurrence(motion: Motion) -> float:
        """How near to its start the state comes again, after a fifth of the time, in parts of its own sweep."""
        state = np.hstack([motion.theta, motion.dtheta * np.sqrt(motion.length / 9.81)])
        late = motion.t > motion.t[-1] / 5
        return float(np.abs(state[late]).max(axis=1).min() / np.ptp(state, axis=0).max())

    seconds = float(hand.t[-1])
    equal, printed = by_hand(1.0, seconds, (1.0, 1.0)), by_hand(1.0, seconds, variant="printed")
    near, far = recurrence(hand), recurrence(equal)
    right, wrong = (float(np.ptp(m.theta[:, 1])) for m in (hand, printed))
    return [
        Claim(
            "the motion nearly repeats with m1 : m2 = 3 : 1",
            near < 0.05,
            f"angles and speeds come back to within {100 * near:.0f} % of their sweep",
        ),
        Claim(
            "the motion nearly repeats with m1 : m2 = 1 : 1",
            far < 0.05,
            f"angles and speeds come back to within {100 * far:.0f} % of their sweep at best",
        ),
        Claim(
            "the C matrix as printed gives this motion",
            abs(wrong / right - 1) < 0.1,
            f"the elbow then sweeps {wrong:.1f} rad instead of {right:.1f}: the figures come from the right matrix",
        ),
    ]


def draw(black: Motion, grey: Motion, title: str, path: Path) -> Path:
    """Figures 6 to 13 on one sheet: angles and velocities over time, and the phase plots of both models."""
    figure, axes = new_figure(4, 2, size=(11, 13))
    panels: list[tuple[str, str, str, Callable[[Motion], Any], Callable[[Motion], Any]]] = [
        ("Fig. 6", "time t (s)", "theta1 (rad)", lambda m: m.t, lambda m: m.theta[:, 0]),
        ("Fig. 7", "time t (s)", "theta2 (rad)", lambda m: m.t, lambda m: m.theta[:, 1]),
        ("Fig. 8", "time t (s)", "theta1' (rad/s)", lambda m: m.t, lambda m: m.dtheta[:, 0]),
        ("Fig. 9", "time t (s)", "theta2' (rad/s)", lambda m: m.t, lambda m: m.dtheta[:, 1]),
    ]
    for axis, (name, x, y, horizontal, vertical) in zip(axes.flat, panels, strict=False):
        axis.plot(horizontal(grey), vertical(grey), color=GREY, linewidth=3.2, label="URDF + Pinocchio")
        axis.plot(horizontal(black), vertical(black), color=BLACK, linewidth=1.1, label="hand-derived")
        axis.set(title=name, xlabel=x, ylabel=y)
    phases = [
        ("Fig. 10", black, 0, BLACK),
        ("Fig. 11", black, 1, BLACK),
        ("Fig. 12", grey, 0, GREY),
        ("Fig. 13", grey, 1, GREY),
    ]
    for axis, (name, motion, link, colour) in zip(axes.flat[4:], phases, strict=True):
        theta, speed = motion.theta[:, link], motion.dtheta[:, link]
        axis.plot(theta, speed, color=colour, linewidth=1.3)
        axis.plot(theta[0], speed[0], "o", color="#D55E00", markersize=6, label="start")
        axis.set(
            title=f"{name}: link {link + 1}",
            xlabel=f"theta{link + 1} (rad)",
            ylabel=f"theta{link + 1}' (rad/s)",
        )
    handles = [*axes[0, 0].get_lines()[::-1], axes[2, 0].get_lines()[1]]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(title)
    return save_figure(figure, path)
