"""The paper's figures 6 to 13 drawn again, and each of its statements answered with a number.

Black is the paper's hand-derived ("computerised") model, as corrected in twolink.lagrange. Grey is its "links oriented"
model, here URDF + Pinocchio. Figs. 10 and 11 are of link one, 12 and 13 of link two; 10 and 12 of the first model.

Source: S. N. H. Umar and E. Abu Bakar, "Study on Trajectory Motion and Computational Analysis of Robot Manipulator".
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twolink.paper.beyond import LIKE_FIGURE_6, FirstSwing, draw_beyond, first_swing
from twolink.paper.claims import Claim, beyond_claims, motion_claims
from twolink.paper.model_claims import model_claims
from twolink.paper.motions import ACCURACY, CYCLES, TOLERANCE, ArmMotion, by_hand, by_urdf, cycle_time
from twolink.paper.ode45 import ATOL, RTOL, DefaultsStudy, defaults_study, draw_defaults
from twolink.show.figure import new_figure, save_figure

BLACK_LINE: dict[str, Any] = {"color": "0.0", "linewidth": 1.1, "label": "computerised: derived by hand"}
GREY_LINE: dict[str, Any] = {"color": "0.62", "linewidth": 3.2, "label": "links oriented: URDF + Pinocchio"}
START = "#D55E00"
ANGLE, SPEED = ("$\\theta_1$", "$\\theta_2$"), ("$\\dot\\theta_1$", "$\\dot\\theta_2$")
ANSWERS = {True: "yes", False: "NO", None: "opinion"}


@dataclass(frozen=True)
class PaperStudy:
    """The answered claims, the pictures, and the largest difference of the two models with equal parameters [rad]."""

    claims: tuple[Claim, ...]
    pictures: tuple[Path, ...]
    difference: float

    def text(self) -> str:
        """The claims and answers as plain text."""
        head = f"hand-derived against URDF + Pinocchio, same parameters: largest difference {self.difference:.1e} rad"
        lines = [f"  {ANSWERS[c.holds]:<8}{c.text} ({c.where})\n          {c.found}" for c in self.claims]
        return "\n".join([head, *lines, *(f"drawn: {path}" for path in self.pictures)])


def study(out: Path) -> PaperStudy:
    """Simulate, answer the claims, and draw all figures into the folder `out`."""
    period = cycle_time(by_hand(1.0, 4.0))  # of links of 1 m; it scales with the square root of the length
    hand, urdf = by_hand(1.0, CYCLES * period), by_urdf(1.0, CYCLES * period)
    slow, fast = by_hand((3.0 / period) ** 2, CYCLES * 3.0), by_urdf((0.75 / period) ** 2, CYCLES * 0.75)
    difference = float(np.abs(hand.theta - urdf.theta).max())
    swing, example = first_swing(), by_hand((0.75 / period) ** 2, CYCLES * 0.75, **LIKE_FIGURE_6)
    defaults = defaults_study(slow.length, CYCLES * 3.0)
    same = f"Figs. 6 to 13 with the same parameters: both models differ by {difference:.0e} rad at most"
    pictures = (
        draw(hand, urdf, same, out / "paper-same-parameters.png"),
        draw(slow, fast, "Figs. 6 to 13 with the paper's cycles of 3 s and 0.75 s",
             out / "paper-cycles-3s-and-0.75s.png"),
        _draw_beyond(swing, example, out / "paper-beyond-pi.png"),
        _draw_defaults(defaults, out / "paper-ode45.png"),
    )  # fmt: skip
    claims = (
        *model_claims(hand, difference, defaults),
        *beyond_claims(swing, example),
        *motion_claims(hand, slow, fast, period),
    )
    return PaperStudy(claims, pictures, difference)


def draw(black: ArmMotion, grey: ArmMotion, title: str, path: Path) -> Path:
    """Figures 6 to 13 on one sheet: angles and speeds over time, and the phase plots of both models."""
    figure, axes = new_figure(4, 2, size=(11, 13))
    for i, axis in enumerate(axes.flat[:4]):
        link, speeds = i % 2, i >= 2
        for motion, style in ((grey, GREY_LINE), (black, BLACK_LINE)):
            axis.plot(motion.t, (motion.dtheta if speeds else motion.theta)[:, link], **style)
        quantity = "velocity" if speeds else "position"
        ylabel = f"{SPEED[link]} (rad/s)" if speeds else f"{ANGLE[link]} (rad)"
        axis.set(title=f"Fig. {6 + i}: {quantity} angle of link {link + 1}", xlabel="time t (s)", ylabel=ylabel)
    for i, axis in enumerate(axes.flat[4:]):
        link, (motion, style) = i // 2, (grey, GREY_LINE) if i % 2 else (black, BLACK_LINE)
        theta, speed = motion.theta[:, link], motion.dtheta[:, link]
        axis.plot(theta, speed, color=style["color"], linewidth=1.3)
        axis.plot(theta[0], speed[0], "o", color=START, markersize=6, label="start")
        axis.set(title=f"Fig. {10 + i}: link {link + 1}, {style['label'].partition(':')[0]}")
        axis.set(xlabel=f"{ANGLE[link]} (rad)", ylabel=f"{SPEED[link]} (rad/s)")
    handles = [*axes[0, 0].get_lines()[::-1], axes[2, 0].get_lines()[1]]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(f"{title}\n{_about(black, f'black: DOP853, tolerance {TOLERANCE:.0e}')}\n"
                    f"{_about(grey, f'grey: error at most {ACCURACY:.0e} rad')}", fontsize=11)  # fmt: skip
    return save_figure(figure, path)


def _about(motion: ArmMotion, name: str) -> str:
    """Lengths, masses and accuracy of a motion, for a caption."""
    (m1, m2), second = motion.masses, motion.ratio * motion.length
    return f"{name}; l1 = {motion.length:.4g} m, l2 = {second:.4g} m, m1 = {m1:g} kg, m2 = {m2:g} kg"


def _draw_beyond(swing: FirstSwing, motion: ArmMotion, path: Path) -> Path:
    figure, axes = new_figure(1, 2, size=(11, 4.6))
    draw_beyond(swing, motion, axes[0])
    about = _about(motion, f"Right: derived by hand, DOP853, tolerance {TOLERANCE:.0e}")
    figure.suptitle(f"Link 1 beyond $-\\pi$. {about}", fontsize=10)
    return save_figure(figure, path)


def _draw_defaults(study: DefaultsStudy, path: Path) -> Path:
    figure, axes = new_figure(1, 3, size=(14, 4.6))
    draw_defaults(study, axes[0])
    figure.suptitle(f"ode45's pair on the paper's release (SciPy's RK45; defaults: rtol {RTOL:g}, atol {ATOL:g}). "
                    f"{_about(study.right, 'Derived by hand')}", fontsize=10)  # fmt: skip
    return save_figure(figure, path)
