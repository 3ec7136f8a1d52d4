"""The result of a fit by simulation: values with intervals, the scene with them, what cannot be told, and residuals."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.dynamics import Robot
from twolink.parts.identification.result import MAX_LINES, MEASURED, Estimate, draw_ellipse
from twolink.scenes import Scene
from twolink.show.figure import COLOURS, new_figure, plain
from twolink.simulation.text import as_data

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SceneFit(Estimate):
    """Parameters of a scene from a measured motion: an `Estimate`.

    Attributes
    ----------
    scene : Scene
        The scene with what was found; what cannot be told is as near to the first guess as the rest allows.
    start : Scene
        The scene as it was given.
    parameters : dict
        The values in `scene` of all that was looked for, SI units.
    channels : tuple of str, (c,)
        What was measured: q.JOINT, v.JOINT.
    measured : ndarray, (n, c)
        Measured values.
    singular_values : ndarray, (k,)
        Of the derivatives of the measurements, in noise, by relative changes of the parameters: 1 is a change by the
        parameter's own size that is as large as the noise.
    segments : int
        Of multiple shooting; 1: the motion was simulated in one piece.
    gap : float
        The largest gap between segments, rad, m, per second.
    converged : bool
        Whether the search ended before it had to.
    explained : bool
        Whether residuals are small beside what was measured.
    simulations : int
        How many motions were simulated.
    interrupted : bool
        Ctrl-C or the end of its time ended the search; this is the best so far.
    """

    scene: Scene
    start: Scene
    parameters: dict[str, float]
    channels: tuple[str, ...]
    measured: np.ndarray
    singular_values: np.ndarray
    segments: int
    gap: float
    converged: bool
    explained: bool
    simulations: int
    interrupted: bool = False

    @property
    def found(self) -> Robot:
        """The robot with what was found; all of its bodies can exist."""
        return self.scene.robot

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons against trusting the values, in words; empty where there are none."""
        texts = []
        if not self.explained:
            texts.append("the scene's motion is not the measured one: values and intervals cannot be trusted; "
                         "give a better first guess, more segments, or the effects that the scene lacks")  # fmt: skip
        elif self.correlated:
            texts.append("residuals are correlated in time: effects may be missing in the scene (friction?), or this "
                         "is not the best fit; the intervals allow for it")  # fmt: skip
        if not self.converged:
            texts.append("interrupted: this is the best so far" if self.interrupted else
                         "the search ended before it converged")  # fmt: skip
        return tuple(texts)

    def to_dict(self) -> dict[str, Any]:
        """A record for JSON."""
        names = ("parameters", "singular_values", "segments", "gap", "simulations", "converged", "interrupted",
                 "explained", "warnings")  # fmt: skip
        return self._record(self.channels) | {name: as_data(getattr(self, name)) for name in names}

    def _figure(self) -> "Figure":
        """Measured and fitted motion and the residuals; the covariance of two values, and the singular values."""
        figure, axes = new_figure(3, 2, size=(9, 8.5), height_ratios=(1.2, 1, 1.2))
        for row in (0, 1):
            axes[row, 1].remove()
            axes[row, 0].set_subplotspec(axes[row, 0].get_gridspec()[row, :])
        _draw_motion(axes[0, 0], axes[1, 0], self)
        draw_ellipse(axes[2, 0], self)
        _draw_singular_values(axes[2, 1], self)
        figure.suptitle(plain(f"{self.robot.name}: {len(self.estimate)} found from {len(self.t)} samples"))
        return figure

    def __str__(self) -> str:
        pieces = "one piece" if self.segments == 1 else f"{self.segments} segments (gaps up to {self.gap:.1e})"
        head = f"{self.robot.name}: {len(self.estimate)} found from {len(self.t)} samples by simulation in {pieces}"
        lines = [f"{head}, {self.method} least squares, {self.simulations} simulations", "", str(self.table()), ""]
        lines.append(f"low, high: {100 * self.confidence:g} % intervals; condition {self.condition:.3g}")
        noises = zip(self.channels, self.noise.tolist(), strict=True)
        lines.append("noise: " + ", ".join(f"{name} {value:.3g}" for name, value in noises))
        lines += self.not_told("measurement", "too weak beside the noise")
        return "\n".join([*lines, *(f"warning: {text}" for text in self.warnings)])

    __repr__ = __str__


def _draw_motion(above: Any, below: Any, fit: SceneFit) -> None:
    """The channels above; what is left of them, in noise, below."""
    for k, (name, colour) in enumerate(zip(fit.channels[:MAX_LINES], COLOURS, strict=False)):
        above.plot(fit.t, fit.measured[:, k], color=colour, **MEASURED)
        above.plot(fit.t, fit.measured[:, k] - fit.residuals[:, k], color=colour, linewidth=1.2, label=plain(name))
        below.plot(fit.t, fit.residuals[:, k] / fit.noise[k], color=colour, **MEASURED)
    title = None if len(fit.channels) <= MAX_LINES else f"the first {MAX_LINES} of {len(fit.channels)}"
    above.legend(loc="upper left", bbox_to_anchor=(1.01, 1), title=title)
    above.set(ylabel="dots measured, lines fitted\n(rad, m, per second)")
    below.set(xlabel="time t (s)", ylabel="measured - fitted\n(standard deviations)")


def _draw_singular_values(axis: Any, fit: SceneFit) -> None:
    """All of them, and the noise; those that are 0 at the lower edge."""
    shown, rank = np.maximum(fit.singular_values, 1e-6), len(fit.estimate)
    numbers = np.arange(1, len(shown) + 1)
    axis.semilogy(numbers[:rank], shown[:rank], "o", color=COLOURS[0], label="found")
    if rank < len(shown):
        axis.semilogy(numbers[rank:], shown[rank:], "x", color=COLOURS[5], label="cannot be told")
    axis.axhline(1.0, color="0.4", linewidth=1)
    axis.set(xlabel="direction", ylim=(5e-7, None))
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.set_title("change by the parameters' size, in noise", loc="left")
    axis.legend()
