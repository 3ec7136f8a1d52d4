"""Errors of the model, shown by its residuals: a test of every parameter, joint model and error of the setup left out.

For a column z that is not in the model, z~ its part that the columns of the model do not explain, and e the residuals,

    d = z~^T e / z~^T z~

is the coefficient that z would have, its variance that of the scores z~ (e - z~ d), which may follow each other (Newey
and West 1987). It is a model error where |d|, less what the filter may do, is beyond Student's
quantile for 1 in 1000 of all columns that are tried. Together with d the estimates would move by -G^+ z d.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from scipy.special import stdtrit

from twolink.parts.identification.regression import correlation_length, moving_sums, rows_of

_CHANCE = 1e-3  # that a test of all columns errs
_OWN = 1e-6  # of z^T z: less than this is explained by the model's own columns
_SMALL = 1e-9  # of the torques: what rounding may do
HARM = 3.0  # standard errors that an estimate may be wrong by


@dataclass(frozen=True)
class ModelError:
    """A name, how far it is off the model with its standard error, and how far it moves the estimates.

    moved: standard errors of the combination `of` that would move most.
    """

    name: str
    value: float
    error: float
    moved: float
    of: str

    def __str__(self) -> str:
        where = f"; with it {self.of} would move by {self.moved:.2g} standard errors"
        return f"the residuals show {self.name} off by {self.value:.3g} +- {self.error:.1g}{where}"

    def to_dict(self) -> dict[str, Any]:
        """A record for JSON."""
        return {"name": self.name, "value": self.value, "standard_error": self.error, "moved": self.moved,
                "of": self.of}  # fmt: skip


def model_errors(
    names: Sequence[str], tried: np.ndarray, columns: np.ndarray, combinations: Sequence[str], fit: Any,
    wide: np.ndarray | None, sure: np.ndarray, torques: np.ndarray,
) -> tuple[ModelError, ...]:  # fmt: skip
    """The columns tried (n, nv, m) that the residuals ask for, the clearest first.

    columns (n, nv, r): of the model. fit: by them. wide: residuals (n, nv) by a wider window. sure: of the prior.
    """
    n, counts = len(columns), np.sqrt(fit.share) / fit.noise
    weighted, z = rows_of(columns, counts), rows_of(tried, counts)
    lengths = np.linalg.norm(weighted, axis=0)
    q, triangle = scipy.linalg.qr(np.vstack([weighted / lengths, np.diag(sure / lengths)]), mode="economic")
    q = q[: len(weighted)]
    along = q.T @ z
    left = z - q @ along
    squares = np.sum(left**2, axis=0)
    new = squares > _OWN * np.maximum(np.sum(z**2, axis=0), 1e-300)
    moves = scipy.linalg.solve_triangular(triangle, along) / lengths[:, None]
    errors = np.sqrt(np.diag(fit.covariance))
    residual = (fit.residuals * counts).ravel()
    coarse = residual if wide is None else (wide * counts).ravel()
    least = _SMALL * np.linalg.norm(torques / fit.noise)
    found = []
    for k in np.flatnonzero(new).tolist():
        value, other = (float(left[:, k] @ e / squares[k]) for e in (residual, coarse))
        rest = (residual - value * left[:, k]).reshape(n, -1)
        length = correlation_length(rest)
        scores = np.sum(rest * left[:, k].reshape(n, -1), axis=1)[:, None]
        error = float(np.sqrt(np.sum(moving_sums(scores, length) ** 2) / (length + 1))) / squares[k]
        clear = stdtrit(max(n / (length + 1) - 1, 1.0), 1 - _CHANCE / len(names) / 2) * error
        if abs(value) - abs(other - value) > clear and abs(value) * np.sqrt(squares[k]) > least:
            shift = np.abs(moves[:, k] * value) / errors
            worst = int(np.argmax(shift))
            found.append(ModelError(names[k], value, error, float(shift[worst]), combinations[worst]))
    return tuple(sorted(found, key=lambda one: -abs(one.value) / one.error))
