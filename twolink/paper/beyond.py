"""Link one beyond -pi: for which lengths and masses the first swing passes it, as the paper's Figure 6 shows.

Where it does, an angle that is wrapped to (-pi, pi] jumps by 2 pi, as the paper's links oriented model does.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from twolink.lagrange import two_link
from twolink.paper.motions import MASSES, ArmMotion, G

MASS_RATIOS = np.geomspace(0.25, 16.0, 31)  # m1 / m2
LENGTH_RATIOS = np.geomspace(0.25, 4.0, 33)  # l2 / l1
SECONDS, TIMES = 2.6, 1301  # of links of 1 m: the first swing is over
LIKE_FIGURE_6: dict[str, Any] = {"masses": (2.0, 1.0), "ratio": 1.12}  # passes -pi, and nearly repeats


@dataclass(frozen=True)
class FirstSwing:
    """The swing of link 1 before it first turns, (masses, lengths) [rad], by m1 / m2 and l2 / l1.

    By dimensions nothing else counts: gravity and l1 set the time alone, and all masses together nothing.
    """

    mass_ratios: np.ndarray
    length_ratios: np.ndarray
    lowest: np.ndarray

    @property
    def passes(self) -> np.ndarray:
        """Mask of the arms that pass -pi, (masses, lengths)."""
        return np.asarray(self.lowest < -np.pi)

    def range_of_lengths(self, mass_ratio: float) -> tuple[float, float]:
        """The smallest and the largest l2 / l1 of the grid that passes -pi, at the grid's nearest m1 / m2."""
        i = int(np.argmin(np.abs(np.log(self.mass_ratios / mass_ratio))))
        found = self.length_ratios[self.passes[i]]
        return (float(found.min()), float(found.max())) if len(found) else (np.nan, np.nan)


def first_swing(mass_ratios: np.ndarray = MASS_RATIOS, length_ratios: np.ndarray = LENGTH_RATIOS) -> FirstSwing:
    """Release arms of all these proportions, as one batch, and follow each to its first turn."""
    from scipy.integrate import solve_ivp

    masses, ratios = (grid.ravel() for grid in np.meshgrid(mass_ratios, length_ratios, indexing="ij"))
    arms = two_link((np.ones(len(masses)), ratios), (masses, np.ones(len(masses))), G)
    times, still = np.linspace(0.0, SECONDS, TIMES), np.zeros(2)

    def rate(_t: float, x: np.ndarray) -> np.ndarray:
        theta, speed = x.reshape(2, -1, 2)
        return np.stack([speed, arms.forward_dynamics(theta, speed, still)]).ravel()

    start = np.zeros(4 * len(masses))
    solution = solve_ivp(rate, (0.0, SECONDS), start, "DOP853", times, rtol=1e-7, atol=1e-7)
    x = solution.y.reshape(2, len(masses), 2, -1)
    theta1, speed1 = x[0, :, 0], x[1, :, 0]
    turned = np.cumsum((speed1[:, :-1] < 0.0) & (speed1[:, 1:] >= 0.0), axis=1) > 0
    swinging = np.hstack([np.ones((len(masses), 1), bool), ~turned])
    lowest = np.where(swinging, theta1, np.inf).min(axis=1)
    return FirstSwing(mass_ratios, length_ratios, lowest.reshape(len(mass_ratios), len(length_ratios)))


def wrapped(motion: ArmMotion) -> np.ndarray:
    """theta1 (n,) in (-pi, pi], as a sensor of a joint gives it."""
    return np.asarray(np.pi - np.mod(np.pi - motion.theta[:, 0], 2 * np.pi))


def draw_beyond(swing: FirstSwing, motion: ArmMotion, axes: Any) -> None:
    """The map of proportions that pass -pi, and link 1 of one of them, wrapped."""
    place, time = axes
    place.contourf(swing.length_ratios, swing.mass_ratios, swing.lowest, levels=[-2 * np.pi, -np.pi], colors=["0.7"])
    place.set(xscale="log", yscale="log", xlabel="l2 / l1", ylabel="m1 / m2",
              title="grey: $\\theta_1$ passes $-\\pi$ in the first swing")  # fmt: skip
    for axis in (place.xaxis, place.yaxis):
        axis.set_ticks([0.25, 0.5, 1, 2, 4, 8, 16])
        axis.set_major_formatter("{x:g}")
        axis.minorticks_off()
    other = motion.ratio, motion.masses[0] / motion.masses[1], "shown on the right"
    marked = (1.0, MASSES[0] / MASSES[1], "as drawn in Figs. 6 to 13"), other
    for ratio, mass, name in marked:
        place.plot(ratio, mass, "o", color="#D55E00", markersize=6)
        place.annotate(name, (ratio, mass), xytext=(8, 4), textcoords="offset points", fontsize=8)
    time.plot(motion.t, motion.theta[:, 0], color="0.62", linewidth=3.2, label="$\\theta_1$")
    time.plot(motion.t, wrapped(motion), color="0.0", linewidth=1.1, label="$\\theta_1$ wrapped to $(-\\pi, \\pi]$")
    time.axhline(-np.pi, color="0.5", linewidth=0.7, linestyle=":")
    time.set(xlabel="time t (s)", ylabel="$\\theta_1$ (rad)", ylim=(-3.8, 5.0))
    time.set_title("Fig. 6's jump: m1 : m2 = {:g} : {:g}, l2 = {:g} l1".format(*motion.masses, motion.ratio))
    time.legend(loc="upper left", ncols=2, frameon=False)
