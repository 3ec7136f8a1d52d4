"""The figures of a fit by simulation, and of an identification by regression."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from twolink.show.figure import COLOURS, new_figure, plain, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_LINES, MAX_SPANS = 6, 20
MEASURED: dict[str, Any] = {"linestyle": "", "marker": ".", "markersize": 2.5, "alpha": 0.5}


class Estimated(Protocol):
    """What an estimate is drawn from; as of `Estimate`, with the probability of the region."""

    @property
    def combinations(self) -> tuple[str, ...]:
        """Names (r,)."""

    @property
    def estimate(self) -> np.ndarray:
        """Values (r,)."""

    @property
    def covariance(self) -> np.ndarray:
        """Of the values (r, r)."""

    @property
    def half_width(self) -> np.ndarray:
        """Of the intervals (r,)."""

    @property
    def confidence(self) -> float:
        """The probability of the region."""


class Drawn(NamedTuple):
    """What is drawn of a `SceneFit`, whose attributes these are."""

    robot: str
    t: np.ndarray
    channels: tuple[str, ...]
    measured: np.ndarray
    residuals: np.ndarray
    noise: np.ndarray
    combinations: tuple[str, ...]
    estimate: np.ndarray
    covariance: np.ndarray
    half_width: np.ndarray
    confidence: float
    singular_values: np.ndarray


def plot_fit(fit: Drawn, path: Path | None) -> "Path | Figure":
    """Draw measured and fitted motion and the residuals; the covariance of two values, and the singular values."""
    figure, axes = new_figure(3, 2, size=(9, 8.5), height_ratios=(1.2, 1, 1.2))
    for row in (0, 1):
        axes[row, 1].remove()
        axes[row, 0].set_subplotspec(axes[row, 0].get_gridspec()[row, :])
    _draw_motion(axes[0, 0], axes[1, 0], fit)
    _draw_ellipse(axes[2, 0], fit)
    _draw_singular_values(axes[2, 1], fit)
    figure.suptitle(plain(f"{fit.robot}: {len(fit.estimate)} found from {len(fit.t)} samples"))
    return figure if path is None else save_figure(figure, path)


def plot_identification(
    title: str, found: Estimated, t: np.ndarray, residuals: dict[str, np.ndarray], path: Path | None
) -> "Path | Figure":
    """Draw residuals (n,) by joint in their standard deviations, the covariance of two values, and all their intervals.

    The intervals are relative to the values, in the order of their widths.
    """
    figure, axes = new_figure(2, 2, size=(9, 6.5), height_ratios=(1, 1.3))
    axes[0, 1].remove()
    above, ellipse, spans = axes[0, 0], axes[1, 0], axes[1, 1]
    above.set_subplotspec(above.get_gridspec()[0, :])
    for (name, values), colour in zip(list(residuals.items())[:MAX_LINES], COLOURS, strict=False):
        above.plot(t, values, color=colour, label=plain(name), **MEASURED)
    above.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    above.set(xlabel="time t (s)", ylabel="measured - fitted\n(standard deviations)")
    _draw_ellipse(ellipse, found)
    relative = found.half_width / np.maximum(np.abs(found.estimate), 1e-300)
    order = np.argsort(relative)[-MAX_SPANS:]
    spans.semilogx(relative[order], np.arange(len(order)), "o", color=COLOURS[0])
    spans.set_yticks(np.arange(len(order)), [plain(_short(found.combinations[k])) for k in order], fontsize=7)
    spans.axvline(1.0, color="0.4", linewidth=1)
    spans.set_title(f"{100 * found.confidence:g} % interval, relative", loc="left", fontsize=10)
    figure.suptitle(plain(title))
    return figure if path is None else save_figure(figure, path)


def _short(name: str) -> str:
    return name if len(name) < 40 else f"{name[:37]}..."


def _draw_motion(above: Any, below: Any, fit: Drawn) -> None:
    """The channels above; what is left of them, in noise, below."""
    for k, (name, colour) in enumerate(zip(fit.channels[:MAX_LINES], COLOURS, strict=False)):
        above.plot(fit.t, fit.measured[:, k], color=colour, **MEASURED)
        above.plot(fit.t, fit.measured[:, k] - fit.residuals[:, k], color=colour, linewidth=1.2, label=plain(name))
        below.plot(fit.t, fit.residuals[:, k] / fit.noise[k], color=colour, **MEASURED)
    title = None if len(fit.channels) <= MAX_LINES else f"the first {MAX_LINES} of {len(fit.channels)}"
    above.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False, title=title)
    above.set(ylabel="dots measured, lines fitted\n(rad, m, per second)")
    below.set(xlabel="time t (s)", ylabel="measured - fitted\n(standard deviations)")


def _draw_ellipse(axis: Any, fit: Estimated) -> None:
    """The region of the two values that are correlated most; the interval of a single one."""
    names = [_short(name) for name in fit.combinations]
    if len(names) == 1:
        axis.errorbar(fit.estimate, [0.0], xerr=fit.half_width, fmt="o", color=COLOURS[0], capsize=4)
        axis.set(xlabel=plain(names[0]), yticks=[])
    else:
        deviations = np.sqrt(np.diag(fit.covariance))
        correlation = np.abs(fit.covariance / np.outer(deviations, deviations)) - np.eye(len(deviations))
        pair = list(np.unravel_index(int(np.argmax(correlation)), correlation.shape))
        turn = np.linspace(0.0, 2 * np.pi, 200)
        reach = np.sqrt(-2 * np.log(1 - fit.confidence))  # of the normal distribution of two values
        values, vectors = np.linalg.eigh(fit.covariance[np.ix_(pair, pair)])
        circle = np.sqrt(np.maximum(values, 0.0))[:, None] * np.array([np.cos(turn), np.sin(turn)])
        x, y = fit.estimate[pair][:, None] + reach * vectors @ circle
        axis.plot(x, y, color=COLOURS[0])
        axis.plot(*fit.estimate[pair], "o", color=COLOURS[0], markersize=4)
        axis.set(xlabel=plain(names[pair[0]]), ylabel=plain(names[pair[1]]))
        axis.xaxis.label.set_fontsize(8)
        axis.yaxis.label.set_fontsize(8)
    axis.ticklabel_format(useOffset=False)
    axis.tick_params(axis="x", labelrotation=20)
    axis.set_title(f"{100 * fit.confidence:g} % region of the noise", loc="left", fontsize=10)


def _draw_singular_values(axis: Any, fit: Drawn) -> None:
    """All of them, and the noise; those that are 0 at the lower edge."""
    shown, rank = np.maximum(fit.singular_values, 1e-6), len(fit.estimate)
    numbers = np.arange(1, len(shown) + 1)
    axis.semilogy(numbers[:rank], shown[:rank], "o", color=COLOURS[0], label="found")
    if rank < len(shown):
        axis.semilogy(numbers[rank:], shown[rank:], "x", color=COLOURS[5], label="cannot be told")
    axis.axhline(1.0, color="0.4", linewidth=1)
    axis.set(xlabel="direction", ylim=(5e-7, None))
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.set_title("change by the parameters' size, in noise", loc="left", fontsize=10)
    axis.legend(fontsize=8, frameon=False)
