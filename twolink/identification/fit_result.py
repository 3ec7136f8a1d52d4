"""What a fit by simulation found: values with intervals, the scene with them, what cannot be told, and residuals."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.dynamics import Robot
from twolink.identification.result import Estimate
from twolink.scenes import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class SceneFit(Estimate):
    """Parameters of a scene from a measured motion.

    Attributes
    ----------
    scene : Scene
        The scene with what was found; what cannot be told is as near to the first guess as the rest allows.
    start : Scene
        The scene as it was given.
    parameters : dict
        The values in `scene` of all that was looked for, SI units.
    combinations : tuple of str, (r,)
        What was found: names of parameters that can be told alone, and sums such as "forearm.mass + hand.mass".
    matrix : ndarray, (r, k)
        The combinations' coefficients.
    estimate : ndarray, (r,)
        Their values.
    covariance : ndarray, (r, r)
        Of the estimate, from the noise of the measurements.
    numerical_error : ndarray, (r,)
        Bound on the error from simulation, optimisation and rounding; not in the covariance.
    half_width : ndarray, (r,)
        The intervals at `confidence` are estimate +- half_width, numerical error included.
    confidence : float
        The probability of the intervals.
    not_identifiable : tuple of str
        What these measurements cannot show even without noise, in words; it was not fitted.
    not_excited : tuple of str
        What they show too weakly beside their noise: a change as large as the value itself would not be seen. It was
        not fitted.
    channels : tuple of str, (c,)
        What was measured: q.JOINT, v.JOINT.
    noise : ndarray, (c,)
        The standard deviations of the measurements that the intervals are based on.
    t : ndarray, (n,)
        Times of the measurements, s.
    measured, residuals : ndarray, (n, c)
        Measured values, and measured minus simulated ones.
    singular_values : ndarray, (k,)
        Of the derivatives of the measurements, in noise, by relative changes of the parameters: 1 is a change by the
        parameter's own size that is as large as the noise.
    condition : float
        Of those derivatives for what was found, columns of length 1.
    correlated : bool
        Whether residuals follow each other in time: forces are missing in the scene, or the fit is not the best one.
    method : str
        How it was fitted.
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
        Ctrl-C ended the search; this is the best so far.
    """

    scene: Scene
    start: Scene
    parameters: dict[str, float]
    combinations: tuple[str, ...]
    matrix: np.ndarray
    estimate: np.ndarray
    covariance: np.ndarray
    numerical_error: np.ndarray
    half_width: np.ndarray
    confidence: float
    not_identifiable: tuple[str, ...]
    not_excited: tuple[str, ...]
    channels: tuple[str, ...]
    noise: np.ndarray
    t: np.ndarray
    measured: np.ndarray
    residuals: np.ndarray
    singular_values: np.ndarray
    condition: float
    correlated: bool
    method: str
    segments: int
    gap: float
    converged: bool
    explained: bool
    simulations: int
    interrupted: bool = False

    @property
    def robot(self) -> Robot:
        """The robot as it was."""
        return self.start.robot

    @property
    def found(self) -> Robot:
        """The robot with what was found; all of its bodies can exist."""
        return self.scene.robot

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against trusting the values, in words; empty where nothing does."""
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
        return {
            "robot": self.robot.name,
            "method": self.method,
            "samples": len(self.t),
            "confidence": self.confidence,
            "found": self.table().to_records(),
            "parameters": self.parameters,
            "covariance": self.covariance.tolist(),
            "not_identifiable": list(self.not_identifiable),
            "not_excited": list(self.not_excited),
            "noise": dict(zip(self.channels, self.noise.tolist(), strict=True)),
            "singular_values": self.singular_values.tolist(),
            "condition": self.condition,
            "correlated": self.correlated,
            "segments": self.segments,
            "gap": self.gap,
            "simulations": self.simulations,
            "converged": self.converged,
            "interrupted": self.interrupted,
            "explained": self.explained,
            "warnings": list(self.warnings),
        }

    def _draw(self, path: Path | None) -> "Path | Figure":
        """Measured and fitted motion, residuals, the covariance of two values, and the singular values."""
        from twolink.identification.fit_plot import Drawn, plot_fit

        rest = {name: getattr(self, name) for name in Drawn._fields if name != "robot"}
        return plot_fit(Drawn(self.robot.name, **rest), path)

    def __str__(self) -> str:
        pieces = "one piece" if self.segments == 1 else f"{self.segments} segments (gaps up to {self.gap:.1e})"
        head = f"{self.robot.name}: {len(self.estimate)} found from {len(self.t)} samples by simulation in {pieces}"
        lines = [f"{head}, {self.method} least squares, {self.simulations} simulations", "", str(self.table()), ""]
        lines.append(f"low, high: {100 * self.confidence:g} % intervals; condition {self.condition:.3g}")
        noises = zip(self.channels, self.noise.tolist(), strict=True)
        lines.append("noise: " + ", ".join(f"{name} {value:.3g}" for name, value in noises))
        alone = [text.partition(":")[0] for text in self.not_identifiable if ":" in text]
        lines += [f"no measurement depends on: {', '.join(alone)}"] if alone else []
        lines += [f"cannot be identified: {text}" for text in self.not_identifiable if ":" not in text]
        lines += [f"too weak beside the noise: {text}" for text in self.not_excited]
        return "\n".join([*lines, *(f"warning: {text}" for text in self.warnings)])

    __repr__ = __str__
