"""The report of an identification: one HTML file with its figures, to keep and to send."""

import html
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.io.text import Table
from twolink.parts.identification.filtering import Filter, cutoff
from twolink.show.figure import COLOURS, figure_html, new_figure, plain
from twolink.simulation.text import as_data
from twolink.simulation.trajectory_tables import coordinate_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LONGEST = 60  # letters of a sum of parameters; JSON has it whole
_CLEAN = "The residuals show nothing that the model lacks."


def sections(found: Any, notes: Sequence[str]) -> list[tuple[str, str]]:
    """The titles and texts of the report of an `Identification`."""
    joints = coordinate_names(found.robot, "v")
    size = np.sqrt(np.mean(found.torques**2, axis=0))
    residual = np.sqrt(np.mean(found.residuals**2, axis=0))
    shares = as_data(100 * residual / np.where(size > 0, size, np.nan))
    rows = tuple(zip(joints, size.tolist(), residual.tolist(), shares, strict=True))
    torques = Table(("joint", "torque rms", "residual rms", "%"), rows)
    blocks = np.sqrt(np.diag(found.block_covariance)).tolist()
    names = [text if len(text) < _LONGEST else f"{text[:_LONGEST]}..." for text in found.combinations]
    values = tuple((name, *row[1:], error) for name, row, error in zip(names, found.table().rows, blocks, strict=True))
    parameters = Table((*found.table().columns, "standard error by blocks"), values)
    white = "follow each other in time" if found.correlated else "are white"
    said = [str(error) for error in found.model_errors]
    choices = [f"{found.method} least squares; {100 * found.confidence:g} % intervals; condition {found.condition:.3g}"]
    choices += [f"{name} = {value:.6g}" for name, value in zip(found.setup.names, found.setup.values, strict=True)]
    choices += [str(found.filter)] if found.filter is not None else ["accelerations were measured"]
    drawn = found.filter is not None and bool(found.filter.tried)
    models = "" if found.joint_models is None else found.joint_models._repr_html_()
    return [
        ("What is wrong", _lines(found.warnings, bad=True)),
        ("Data", _lines([*notes, f"t from {found.t[0]:.6g} to {found.t[-1]:.6g} s"])),
        ("Choices", _lines(choices) + (_criterion(found.filter, joints) if drawn else "")),
        ("Joint models", models),
        ("Residuals", _lines([f"they {white}"]) + torques._repr_html_() + figure_html(found.plot())),
        ("Parameters", parameters._repr_html_() + figure_html(_correlation(found)) + _lines([str(found.consistency)])),
        ("Model errors", _lines(said or [_CLEAN], bad=bool(said))),
        ("What cannot be known", _lines(found.not_told("torque", "not excited by these data"))),
        ("Validation", "" if found.validation is None else _validation(found.validation, joints)),
    ]  # fmt: skip


def _correlation(found: Any) -> "Figure":
    """The correlation of all that was found, in the order of the table."""
    size = np.sqrt(np.diag(found.covariance))
    figure, axes = new_figure(1, size=(6, 5))
    image = axes[0, 0].imshow(found.covariance / np.outer(size, size), vmin=-1, vmax=1, cmap="RdBu")
    axes[0, 0].set(xlabel="row of the table", ylabel="row of the table", title="correlation")
    figure.colorbar(image)
    return figure


def _lines(texts: Iterable[str], *, bad: bool = False) -> str:
    start = '<p class="bad">' if bad else "<p>"
    return "".join(f"{start}{html.escape(text)}</p>" for text in texts)


def _criterion(by: Filter, joints: Sequence[str]) -> str:
    """Figure of what each window leaves of left-out torques, against its cut-off."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    rate = by.cutoff / cutoff(by.half_window, 1.0)
    figure, axes = new_figure(1, size=(8, 3.5))
    for source, style in (("q", "-"), ("v", "--")):
        rows = sorted((cutoff(half, rate), left) for way, half, left in by.tried if way == source)
        for k, (name, colour) in enumerate(zip(joints, COLOURS, strict=False)):
            label = plain(f"{name}, by {source}")
            axes[0, 0].loglog([x for x, _ in rows], [left[k] for _, left in rows], style, color=colour,
                              label=label if rows else None)  # fmt: skip
    axes[0, 0].axvline(by.cutoff, color="0.4", linewidth=1)
    axes[0, 0].set(xlabel="cut-off (Hz)", ylabel="left of left-out torques\n(N m or N)")
    for axis in (axes[0, 0].xaxis, axes[0, 0].yaxis):  # 1, 2 and 5 of each decade: more names would not fit
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes[0, 0].legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    return figure_html(figure)


def _validation(found: Any, joints: Sequence[str]) -> str:
    """Measured and predicted torques of the runs that were kept out, and the residuals in N m and percent."""
    rows = tuple(zip(joints, found.rms.tolist(), as_data(100 * found.share), strict=True))
    return Table(("joint", "residual rms", "%"), rows)._repr_html_() + figure_html(_torques(found, joints))


def _torques(found: Any, joints: Sequence[str]) -> "Figure":
    figure, axes = new_figure(len(joints), size=(8, 1 + 1.3 * len(joints)), sharex=True)
    for axis, name, measured, residual in zip(axes[:, 0], joints, found.torques.T, found.residuals.T, strict=True):
        axis.plot(measured, color="0.6", linewidth=2, label="measured")
        axis.plot(measured - residual, color=COLOURS[0], linewidth=1, label="predicted")
        axis.set_ylabel(plain(name), fontsize=8)
    axes[0, 0].legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8, frameon=False)
    axes[-1, 0].set_xlabel("sample")
    return figure
