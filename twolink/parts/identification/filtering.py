"""Local polynomials: filtered positions, velocities and accelerations of samples, and the window that suits the data.

Around each sample a polynomial of degree 4 is fitted by least squares to the samples of a window; its value and
derivatives at the sample are q, v and a. For even times this is Savitzky and Golay's filter. Samples nearer to an end
than half a window are left out. Positions are differences in the tangent space, so that quaternions and angles that
pass pi are treated as they should be.

Noise of encoders is rarely white, so that residuals of positions do not tell the window. The torques do: of all windows
that one is taken (the narrowest of those that do alike) whose states predict the torques of left-out parts of the data
best, as they were measured. A window that is too narrow leaves noise in the accelerations, one that is too wide takes
motion away; both show there.

Sources: Savitzky and Golay 1964, "Smoothing and differentiation of data by simplified least squares procedures",
Analytical Chemistry 36; Schafer 2011, "What is a Savitzky-Golay filter?", IEEE Signal Processing Magazine 28 (cut-off).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import factorial
from typing import Literal

import numpy as np

from twolink.dynamics import Robot
from twolink.dynamics.configurations import difference_rows
from twolink.errors import QueryError

DEGREE = 4
SMALLEST = 3  # half a window: 7 samples for the 5 coefficients of the polynomial
_EXCESS = 1.1  # residuals of a window that is not too wide exceed those of the narrowest by less, and by chance
_FOLDS, _PIECES, _LOOKED_AT, _CANDIDATES = 5, 6, 800, 20
FEWEST_RUNS = 3  # that are left out one by one
FASTEST = 100.0  # Hz: rigid bodies that drives move have little above it, their noise has
_WORSE = 1.0  # in the logarithm of the mean square: windows twice that much above the best end the search
ALIKE = 0.02  # of windows that do as well as the best within this, the narrowest keeps most of the motion
_PART = 2_000  # samples whose windows are in memory at once
Source = Literal["q", "v"]
States = tuple[np.ndarray, np.ndarray, np.ndarray]  # q (m, nq), v, a (m, nv)
System = Callable[[States, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Recording:
    """One run: increasing times t (n,), q (n, nq), v and a (n, nv) or None, tau (n, nv), as they were measured."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray | None
    a: np.ndarray | None
    tau: np.ndarray


@dataclass(frozen=True)
class Filter:
    """The window that was taken, samples on each side, and whether velocities are those measured ("v") or of q.

    cutoff: of the window [Hz], -3 dB, of even samples. tried: (source, half window, root mean square by joint) of all
    windows: of the torques of left-out parts less their prediction; empty where the window was given.
    """

    half_window: int
    source: Source
    cutoff: float
    tried: tuple[tuple[Source, int, tuple[float, ...]], ...] = ()

    def __str__(self) -> str:
        kind = "measured velocities" if self.source == "v" else "positions"
        how = f"the best of {len(self.tried)} on left-out torques" if self.tried else "as given"
        width = 2 * self.half_window + 1
        return f"filter: {kind}, polynomials over {width} samples ({self.cutoff:.3g} Hz), {how}"


def cutoff(half: int, rate: float) -> float:
    """The frequency [Hz] at which a window's filter is down by 3 dB, at a rate of samples [Hz] (Schafer 2011)."""
    return rate / 2 * (DEGREE + 1) / (3.2 * half - (4.6 if half >= 25 else 2.0))


def half_window_of(frequency: float, rate: float) -> int:
    """The half window whose cut-off [Hz] is nearest to `frequency`."""
    wide = ((DEGREE + 1) * rate / 2 / frequency + 4.6) / 3.2
    half = wide if wide >= 25 else ((DEGREE + 1) * rate / 2 / frequency + 2.0) / 3.2
    return max(SMALLEST, round(half))


def rate_of(runs: Sequence[Recording]) -> float:
    """The usual rate of samples [Hz]."""
    return float(np.median([(len(run.t) - 1) / (run.t[-1] - run.t[0]) for run in runs]))


def states(robot: Robot, run: Recording, half: int, source: Source, at: np.ndarray) -> States:
    """States at the samples `at` (m,) with `half` others on each side in the window.

    source: "q" differentiates positions twice, "v" measured velocities once.
    """
    parts = [_states(robot, run, half, source, at[k : k + _PART]) for k in range(0, len(at), _PART)]
    q, v, a = (np.concatenate(of) for of in zip(*parts, strict=True))
    return q, v, a


def _states(robot: Robot, run: Recording, half: int, source: Source, at: np.ndarray) -> States:
    weights = _weights(run.t, half, at)
    q, v, a = _of_positions(robot, run.q, weights, half, at)
    if source == "v" and run.v is not None:
        near = np.moveaxis(_windows(run.v, half)[at - half], -1, 1)
        v, a = (_weigh(weights[:, k], near) for k in range(2))
    return np.asarray(robot.integrate(run.q[at], q)), v, a


def choose(robot: Robot, runs: Sequence[Recording], system: System, half: int | None = None) -> Filter:
    """The window and the source of velocities: given, or by cross-validation on the torques.

    system: states and torques (m, nv) -> G (m, nv, k) and y (m, nv) of y = G theta.
    """
    measured: Source = "q" if runs[0].v is None else "v"
    rate = rate_of(runs)
    if half is not None:
        return Filter(half, measured, cutoff(half, rate))
    widest = max(SMALLEST, min(len(run.t) for run in runs) // 8)
    narrow = min(half_window_of(FASTEST, rate), widest)
    stride = max(1, sum(len(run.t) - 2 * widest for run in runs) // _LOOKED_AT)
    places = [np.arange(widest, len(run.t) - widest, stride) for run in runs]
    tried: list[tuple[float, Source, int, np.ndarray]] = []
    for source in dict.fromkeys((measured, "q")):
        best, beyond = np.inf, 0
        for size in np.unique(np.geomspace(narrow, widest, _CANDIDATES).round().astype(int)).tolist():
            pairs = [system(states(robot, run, size, source, at), run.tau[at])
                     for run, at in zip(runs, places, strict=True)]  # fmt: skip
            columns, y = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
            left = Folds(columns, y, np.cumsum([len(at) for at in places]).tolist()).left_out()
            score = float(np.mean(np.log(left)))
            tried.append((score, source, size, np.sqrt(left)))
            best, beyond = min(best, score), beyond + 1 if score > best + _WORSE else 0
            if beyond == 2:
                break
    least = min(one[0] for one in tried)
    _, source, chosen, _ = min((one for one in tried if one[0] <= least + ALIKE), key=lambda one: one[2])
    table = tuple((by, size, tuple(root.tolist())) for _, by, size, root in tried)
    return Filter(chosen, source, cutoff(chosen, rate), table)


class Folds:
    """Parts of the data, each left out in turn: triangles (folds, nv, ., k + 1) of its (G y), by joint.

    columns (n, nv, k), y (n, nv). ends: of the runs; three and more are the parts. share (n, nv): what a torque counts.
    """

    def __init__(
        self, columns: np.ndarray, y: np.ndarray, ends: Sequence[int], share: np.ndarray | None = None
    ) -> None:
        share = np.ones(y.shape) if share is None else share
        lengths = np.maximum(np.linalg.norm(columns, axis=(0, 1)), 1e-300)
        both = np.concatenate([columns / lengths, y[..., None]], axis=2) * np.sqrt(share)[..., None]
        if len(ends) >= FEWEST_RUNS:
            parts = np.split(both, ends[:-1])
        else:  # each of pieces from all over the motion
            pieces = np.array_split(both, _FOLDS * _PIECES)
            parts = [np.concatenate(pieces[k::_FOLDS]) for k in range(_FOLDS)]
        parts = [part for part in parts if len(part)]
        least = max(max(map(len, parts)), both.shape[2])
        filled = np.stack([np.pad(part, ((0, least - len(part)), (0, 0), (0, 0))) for part in parts])
        self.triangles = np.asarray(np.linalg.qr(filled.swapaxes(1, 2), mode="r"))
        grams = self.triangles[..., :-1].swapaxes(-1, -2) @ self.triangles
        self.grams = grams.sum(axis=0) - grams  # of the other parts
        self.count = np.maximum(share.sum(axis=0), 1e-300)
        self.floor = (1e-13 * np.abs(y).max(initial=1e-100)) ** 2

    def left_out(self, keep: Sequence[int] | None = None) -> np.ndarray:
        """The mean square (nv,) of y of each part less its prediction, by the columns `keep`, from the other parts."""
        used = np.arange(self.grams.shape[2]) if keep is None else np.asarray(keep, dtype=int)
        weights, here = np.ones(self.grams.shape[1]), np.append(used, self.grams.shape[2])
        for _ in range(2):
            both = np.tensordot(weights, self.grams[:, :, used][..., here], axes=(0, 1))
            gram = both[..., :-1] + 1e-12 * np.eye(len(used))
            theta = np.linalg.solve(gram, both[..., -1:]) if len(used) else np.zeros((len(both), 0, 1))
            off = self.triangles[..., -1] - (self.triangles[..., used] @ theta[:, None])[..., 0]
            left = np.maximum(np.sum(off**2, axis=(0, 2)) / self.count, self.floor)
            weights = left.min() / left
        return np.asarray(left)


def smooth(robot: Robot, t: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Filtered positions (m, nq) alone, with velocities, accelerations (m, nv) and the half window.

    No torques are known here: the window is the widest whose residuals are the noise that the narrowest shows.
    """
    widest = (len(t) - 1) // 2 - 1
    found, noise = _fit(robot, t, q, SMALLEST)
    limit = noise * (_EXCESS + 6 / np.sqrt(len(t)))
    for wider in np.unique(np.geomspace(SMALLEST, max(SMALLEST, widest // 4), 24).astype(int))[1:]:
        smoothed, residual = _fit(robot, t, q, int(wider))
        if np.any(residual > limit):
            break
        found = smoothed
    return found


def require_samples(count: int, half: int, what: str = "q") -> None:
    """Require the samples of a window and some. Raises QueryError (code "too-few-samples")."""
    if count < 2 * half + 1:
        text = f"{count} samples are too few to differentiate {what}, expected at least {2 * half + 1} in a run"
        raise QueryError(text, argument="t", remedy="give more samples, or v and a", code="too-few-samples")


def _fit(
    robot: Robot, t: np.ndarray, q: np.ndarray, half: int
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray, int], np.ndarray]:
    """The polynomials' values, and the root mean square (nv,) of what they leave of the positions, as noise."""
    at = np.arange(half, len(q) - half)
    weights = _weights(t, half, at)
    value, v, a = _of_positions(robot, q, weights, half, at)
    free = 1.0 - weights[:, 0, half].mean()  # the variance of a residual, in that of the noise
    residual = np.sqrt(np.mean(value**2, axis=0) / free)
    return (np.asarray(robot.integrate(q[at], value)), v, a, half), residual


def _of_positions(
    robot: Robot, q: np.ndarray, weights: np.ndarray, half: int, at: np.ndarray
) -> tuple[np.ndarray, ...]:
    """The difference of the filtered from the measured positions (m, nv), velocities and accelerations."""
    if robot.nq == robot.nv:
        near = np.moveaxis(_windows(q, half)[at - half], -1, 1) - q[at, None]
    else:
        near = np.stack([difference_rows(robot, q[at], q[at + k]) for k in range(-half, half + 1)], axis=1)
    return tuple(_weigh(weights[:, k], near) for k in range(3))


def _weights(t: np.ndarray, half: int, at: np.ndarray) -> np.ndarray:
    """(m or 1, 3, window): what takes samples to value, first and second derivative at the middle."""
    around = _windows(t, half)[at - half] - t[at, None]
    step = (t[-1] - t[0]) / (len(t) - 1)
    if np.abs(np.diff(t) - step).max() < 1e-6 * step:
        around = step * np.arange(-half, half + 1.0)[None]
    reach = np.abs(around).max()
    powers = (around / reach)[..., None] ** np.arange(DEGREE + 1)
    orthogonal, triangle = np.linalg.qr(powers)
    inverse = np.linalg.solve(triangle, np.moveaxis(orthogonal, -1, -2))[:, :3]
    return np.asarray(inverse * np.array([factorial(k) / reach**k for k in range(3)])[:, None])


def _weigh(weights: np.ndarray, near: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("mw,mwk->mk", np.broadcast_to(weights, near.shape[:2]), near))


def _windows(x: np.ndarray, half: int) -> np.ndarray:
    return np.lib.stride_tricks.sliding_window_view(x, 2 * half + 1, axis=0)
