"""The result of an identification: values with intervals, what cannot be told, and whether such a robot can exist.

`Estimate` is what it shares with a fit by simulation.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from twolink.dynamics import Robot
from twolink.io.files import path_to_write
from twolink.io.text import Table
from twolink.parts.identification.base_parameters import Selection, regressor
from twolink.parts.identification.consistency import Consistency, consistent
from twolink.parts.identification.filtering import Filter
from twolink.parts.identification.model_errors import HARM, ModelError
from twolink.parts.identification.report import sections
from twolink.parts.identification.setup import Setup
from twolink.show.figure import COLOURS, Plotted, new_figure, plain
from twolink.show.html_page import write_page
from twolink.simulation.text import BaseResult, as_data
from twolink.simulation.trajectory_tables import coordinate_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_LINES, MAX_SPANS, MOST_SAID = 6, 20, 3
LONGEST, ROW = 60, 240  # letters of a name and of a row
_HARDLY = 0.5  # of a joint's torques: less is the first that is said
MEASURED: dict[str, Any] = {"linestyle": "", "marker": ".", "markersize": 2.5, "alpha": 0.5}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Estimate(BaseResult, Plotted):
    """The estimate that an identification and a fit by simulation share.

    Attributes
    ----------
    robot : Robot
        The robot whose parameters were looked for, as it was.
    combinations : tuple of str, (r,)
        What was found: names of parameters that can be told alone, and sums such as "forearm.mass + hand.mass".
    matrix : ndarray, (r, k)
        The combinations' coefficients.
    estimate : ndarray, (r,)
        Their values, SI units.
    covariance : ndarray, (r, r)
        Of the estimate, from the noise of the measurements.
    numerical_error : ndarray, (r,)
        Bound on the error from rounding and simulation, and an estimate of that from filtering positions; not in the
        covariance.
    half_width : ndarray, (r,)
        The intervals at `confidence` are estimate +- half_width, numerical error included.
    confidence : float
        The probability of the intervals.
    not_identifiable : tuple of str
        What no motion of this robot can show, or these measurements even without noise, in words; it was not fitted.
    not_excited : tuple of str
        What other motions can show and these data do not; of a fit what they show too weakly beside their noise: a
        change as large as the value itself would not be seen. It was not fitted.
    noise : ndarray, (c,)
        The standard deviation of the residuals of each joint, N m or N, or of each channel of a fit, on which the
        intervals are based.
    t : ndarray, (n,)
        Times of the samples that were used, s; a filter leaves out those at the ends.
    residuals : ndarray, (n, c)
        What was measured minus what the estimate gives.
    condition : float
        Of the regressor, or of the derivatives, for what was found, columns of length 1: 1 is best, above 100 the
        motion excites poorly.
    correlated : bool
        Whether residuals follow each other in time: forces are missing in the model, or filters act.
    method : str
        How it was fitted.
    """

    robot: Robot
    combinations: tuple[str, ...]
    matrix: np.ndarray
    estimate: np.ndarray
    covariance: np.ndarray
    numerical_error: np.ndarray
    half_width: np.ndarray
    confidence: float
    not_identifiable: tuple[str, ...]
    not_excited: tuple[str, ...]
    noise: np.ndarray
    t: np.ndarray
    residuals: np.ndarray
    condition: float
    correlated: bool
    method: str

    @property
    def values(self) -> dict[str, float]:
        """The estimate by combination."""
        return dict(zip(self.combinations, self.estimate.tolist(), strict=True))

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """The intervals by combination."""
        low, high = self.estimate - self.half_width, self.estimate + self.half_width
        return dict(zip(self.combinations, zip(low.tolist(), high.tolist(), strict=True), strict=True))

    @property
    def standard_errors(self) -> dict[str, float]:
        """The standard deviations by combination, from the noise of the measurements alone."""
        return dict(zip(self.combinations, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def table(self) -> Table:
        """Value, standard error, numerical error and interval of each combination."""
        errors, spans = self.standard_errors.values(), self.intervals.values()
        rows = zip(self.combinations, self.estimate.tolist(), errors, self.numerical_error.tolist(), spans, strict=True)
        columns = ("parameter", "value", "standard error", "numerical error", "low", "high")
        return Table(columns, tuple((name, x, s, e, *span) for name, x, s, e, span in rows))

    def short_table(self) -> str:
        """The table for people: long sums by what leads them, without the errors that make the interval."""
        whole = self.table().select("parameter", "value", "low", "high")
        return str(Table(whole.columns, tuple((_short(name), *row) for name, *row in whole.rows)))

    def _record(self, noise_of: Iterable[str]) -> dict[str, Any]:
        """The entries that `to_dict` has of both kinds. noise_of: the names of the noise."""
        names = ("robot", "method", "confidence", "covariance", "not_identifiable", "not_excited", "condition",
                 "correlated")  # fmt: skip
        return {name: as_data(getattr(self, name)) for name in names} | {
            "samples": len(self.t), "found": self.table().to_records(),
            "noise": dict(zip(noise_of, self.noise.tolist(), strict=True)),
        }  # fmt: skip

    def not_told(self, nothing: str, weak: str) -> list[str]:
        """Lines on what cannot be told. nothing: what does not depend on it; weak: what is said of what is too weak."""
        alone = [text.partition(":")[0] for text in self.not_identifiable if ":" in text]
        if len(alone) > MAX_LINES:
            owners = Counter(name.rpartition(".")[0] for name in alone)
            alone = [f"{count} of {owner}" for owner, count in owners.items()]
        lines = [f"no {nothing} depends on: {', '.join(alone)}"] if alone else []
        sums = [f"cannot be identified: {_short(text)}" for text in self.not_identifiable if ":" not in text]
        lines += [*sums[:MOST_SAID], *([f"and {len(sums) - MOST_SAID} sums more"] if len(sums) > MOST_SAID else [])]
        return lines + [f"{weak}: {_short(text)}" for text in self.not_excited]


@dataclass(frozen=True, eq=False, repr=False)
class Validation:
    """Runs that were kept out: times t (n,), measured torques (n, nv), and these less their prediction (n, nv)."""

    t: np.ndarray
    torques: np.ndarray
    residuals: np.ndarray

    @property
    def rms(self) -> np.ndarray:
        """The residuals' root mean square (nv,), N m or N."""
        return np.asarray(np.sqrt(np.mean(self.residuals**2, axis=0)))

    @property
    def share(self) -> np.ndarray:
        """The residuals' root mean square (nv,), relative to that of the torques; NaN of torques of 0."""
        size = np.sqrt(np.mean(self.torques**2, axis=0))
        return self.rms / np.where(size > 0, size, np.nan)

    def to_dict(self, names: Iterable[str]) -> dict[str, Any]:
        """A record for JSON."""
        pairs = zip(names, self.rms.tolist(), as_data(self.share), strict=True)
        return {name: {"rms": rms, "share": share} for name, rms, share in pairs}

    def in_words(self, names: Iterable[str]) -> str:
        """The residuals by joint, in N m or N and in percent."""
        pairs = zip(names, self.rms, as_data(100 * self.share), strict=True)
        parts = (f"{name} {rms:.3g} ({'torques of 0' if share is None else f'{share:.0f} % of its torques'})"
                 for name, rms, share in pairs)  # fmt: skip
        return "held-out torques, residuals: " + ", ".join(parts)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Identification(Estimate):
    """Parameters from measured torques: an `Estimate`.

    Attributes
    ----------
    selection : Selection
        What was looked for: k names, and how they change pi.
    metric : ndarray, (r, r)
        In which `found` is nearest: the inverse of the information matrix of least squares, with variances of the
        geometric mean of its own and the intervals'. The former alone takes an impossible mass for a little residual
        (an arm of 10 kg: 80), the latter alone explains less of other runs.
    filter : Filter or None
        The window that was taken, and all that were tried; None where accelerations were measured.
    torques : ndarray, (n, nv)
        Measured torques, N m or N, averaged over the blocks of the filter, at the times t.
    validation : Validation or None
        Residuals of the runs that were kept out.
    setup : Setup
        Delay, zeros, gravity and motor constants, as they were found; see `find`.
    block_covariance : ndarray, (r, r)
        The covariance by a jackknife: blocks of time or runs are left out one after the other. The intervals are no
        narrower, but where samples that were not filtered leave white residuals.
    model_errors : tuple of ModelError
        What the residuals show that the model lacks, the clearest first.
    joint_models : Table or None
        With `joint_model="auto"`: the candidates, and what they left of left-out torques.
    mirrored : ndarray of bool, (nv,)
        Whether a joint's torques follow the negative of what the robot as it was given needs.
    """

    selection: Selection
    metric: np.ndarray
    filter: Filter | None
    torques: np.ndarray
    validation: Validation | None = None
    setup: Setup
    block_covariance: np.ndarray
    model_errors: tuple[ModelError, ...] = ()
    joint_models: Table | None = None
    mirrored: np.ndarray

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names (k) of the parameters that were looked for."""
        return self.selection.names

    @cached_property
    def consistency(self) -> Consistency:
        """The physical consistency of the parameters: whether such bodies can exist, and the nearest that can."""
        names, matrix = self.combinations, self.matrix
        nearest = consistent(self.robot, self.selection, names, matrix, self.estimate, self.covariance, self.metric)
        harmful = tuple(str(error) for error in self.model_errors if error.moved > HARM)
        return replace(nearest, model_errors=(*self.opposite, *harmful))

    @cached_property
    def found(self) -> Robot:
        """The robot with what was found: the consistent parameters nearest to its own that fit the estimate."""
        return self.consistency.robot_of(self.setup.true_robot)

    @property
    def explained(self) -> np.ndarray:
        """The share (nv,) of each joint's mean square torque that the estimate explains; NaN where that is 0."""
        left, size = (np.mean(x**2, axis=0) for x in (self.residuals, self.torques))
        share = np.clip(1 - left / np.maximum(size, 1e-300), 0.0, 1.0)
        return np.where(self.torques.any(axis=0), share, np.nan)

    @property
    def warnings(self) -> list[str]:
        """The joints whose torques are turned round, all 0, or hardly explained, and why where a test says so."""
        names, lines = coordinate_names(self.robot, "v"), []
        for k in np.flatnonzero(self.explained < _HARDLY).tolist():
            why = [str(error) for error in self.model_errors if error.name.startswith(f"{names[k]}.")][:1]
            lines.append(f"{names[k]}: {100 * self.explained[k]:.0f} % of its torques are explained"
                         + f"; {why[0] if why else 'no test says why'}")  # fmt: skip
        without = np.array(names)[np.isnan(self.explained)].tolist()
        said = [f"{', '.join(without)}: all measured torques are 0: there is nothing to explain"] if without else []
        return [*self.opposite, *said, *lines]

    @property
    def opposite(self) -> list[str]:
        """The joints whose torques are `mirrored`, in words."""
        names = np.array(coordinate_names(self.robot, "v"))[self.mirrored].tolist()
        return [f"{name}: its torques have the opposite sign of what the robot as it was given needs" for name in names]

    def predict(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> np.ndarray:
        """Torques (..., nv) of the consistent parameters and the joint model, N m or N, at positions as measured."""
        return self.model_torques(self.setup.position(np.asarray(q, float)), np.asarray(v, float), np.asarray(a, float))

    def model_torques(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, of: Consistency | None = None) -> np.ndarray:
        """Torques (..., nv), N m or N, at the true positions. of: other parameters than the consistent ones."""
        of, width, shape = of or self.consistency, self.selection.width, np.shape(v)
        q, v, a = (x.reshape(-1, x.shape[-1]) for x in (q, v, a))
        tau = regressor(self.setup.true_robot, q, v, a, width) @ of.vector
        terms = (of.parameters[term.name] * term.torque(q, v, a, width) for term in self.selection.terms)
        return np.asarray(sum(terms, tau)).reshape(shape)

    def report(self, path: str | Path, notes: Sequence[str] = ()) -> Path:
        """Write one .html file with its figures: data, choices, residuals, parameters, model errors, validation.

        Parameters
        ----------
        path : str or path
        notes : sequence of str
            What was done to the data, such as the notes of `read_log`.

        Returns
        -------
        Path

        Raises
        ------
        ShowError
            The ending is another one, or the file cannot be written.
        """
        title = f"{self.robot.name}: {len(self.estimate)} parameters from {len(self.t)} samples"
        return write_page(path_to_write(path), title, sections(self, notes))

    def to_dict(self) -> dict[str, Any]:
        """A record for JSON."""
        names = coordinate_names(self.robot, "v")
        kept = {} if self.validation is None else {"validation": self.validation.to_dict(names)}
        by = self.filter
        window = {} if by is None else {"filter": {"half_window": by.half_window, "velocities": by.source,
                                                   "cutoff": by.cutoff}}  # fmt: skip
        more: dict[str, Any] = {"explained": dict(zip(names, as_data(self.explained), strict=True))}
        more |= {"model_errors": [error.to_dict() for error in self.model_errors]}
        if self.joint_models is not None:
            more["joint_models"] = self.joint_models.to_records()
        return self._record(names) | {"consistency": self.consistency.to_dict()} | more | window | kept

    def _figure(self) -> "Figure":
        """Residuals in their standard deviations, the covariance of two values, and all intervals, relative."""
        figure, axes = new_figure(2, 2, size=(9, 6.5), height_ratios=(1, 1.3))
        axes[0, 1].remove()
        above, ellipse, spans = axes[0, 0], axes[1, 0], axes[1, 1]
        above.set_subplotspec(above.get_gridspec()[0, :])
        scaled = (self.residuals / np.maximum(self.noise, 1e-300)).T
        for name, values, colour in zip(coordinate_names(self.robot, "v"), scaled, COLOURS[:MAX_LINES], strict=False):
            above.plot(self.t, values, color=colour, label=plain(name), **MEASURED)
        above.legend(loc="upper left", bbox_to_anchor=(1.01, 1))
        above.set(xlabel="time t (s)", ylabel="measured - fitted\n(standard deviations)")
        draw_ellipse(ellipse, self)
        relative = self.half_width / np.maximum(np.abs(self.estimate), 1e-300)
        order = np.argsort(relative)[-MAX_SPANS:]
        spans.semilogx(relative[order], np.arange(len(order)), "o", color=COLOURS[0])
        spans.set_yticks(np.arange(len(order)), [plain(_short(self.combinations[k])) for k in order], fontsize=7)
        spans.axvline(1.0, color="0.4", linewidth=1)
        spans.set_title(f"{100 * self.confidence:g} % interval, relative", loc="left")
        figure.suptitle(plain(f"{self.robot.name}: {len(self.estimate)} found from {len(self.t)} samples"))
        return figure

    def __str__(self) -> str:
        percent = f"{100 * self.confidence:g} %"
        head = f"{self.robot.name}: {len(self.estimate)} found from {len(self.t)} samples, {self.method} least squares"
        lines = [*self.warnings, head]
        lines += ["", self.short_table(), "", f"low, high: {percent} intervals; condition {self.condition:.3g}"]
        names, explained = coordinate_names(self.robot, "v"), as_data(100 * self.explained)
        rows = tuple(zip(names, self.noise.tolist(), explained, strict=True))
        lines += [str(Table(("joint", "noise of tau", "explained, %"), rows)), ""]
        if self.correlated:
            lines.append("residuals are correlated in time, by missing forces or filters; the intervals allow for it")
        lines += [] if self.filter is None else [str(self.filter)]
        if "delay" in self.setup.names:
            late = f"{1e3 * self.setup.delay:.3g} ms late"
            lines.append(f"the torques of the log are {late}; find=() takes them as they are")
        if self.validation is not None:
            lines.append(self.validation.in_words(names))
        lines += self.not_told("torque", "not excited by these data")
        if self.joint_models is not None:
            (_, *without), *_, (chosen, *left) = self.joint_models.rows
            each = zip(chosen.split(", "), left, without, strict=True)
            lines += [f"joint model of {name}, leaves {x:.3g} of left-out torques, none {y:.3g}" for name, x, y in each]
        lines += [f"model error: {error}" for error in self.model_errors[:MOST_SAID]]
        return "\n".join([*lines, str(self.consistency)])

    __repr__ = __str__


def _short(name: str) -> str:
    """A name, or a sum by its leading parameter and how many more there are."""
    first, *others = re.split(r" [+-] ", name)
    return name if len(name) < LONGEST else f"{first} and {len(others)} more"


def draw_ellipse(axis: Any, fit: Estimate) -> None:
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
    axis.set_title(f"{100 * fit.confidence:g} % region of the noise", loc="left")
