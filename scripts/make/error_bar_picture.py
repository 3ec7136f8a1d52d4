"""Draws docs/pictures/error-bar.png: a double pendulum by twolink with its error bar, and by peers at their defaults.

    python -m scripts.make.error_bar_picture          needs: pip install twolink[peers]

The errors are against a Taylor series in extended precision, whose own error is checked by a second one.
"""

from typing import Any

import numpy as np

import twolink as tl
from scripts.runner import TOP, options
from twolink.hard import SimulationCase, select_cases
from twolink.hard.peers import NAMES, peer_module
from twolink.hard.peers.task import task_of
from twolink.hard.truths import extended_reference
from twolink.show.figure import COLOURS, new_figure, save_figure

SECONDS, SAMPLES, ACCURACY = 10.0, 100, 1e-6
SIZE = 13  # points, of all texts: 9 pixels on a telephone 360 pixels wide
PICTURE = TOP / "docs" / "pictures" / "error-bar.png"


def main() -> None:
    options(__doc__)
    (case,) = select_cases(["chaos"])
    if not isinstance(case, SimulationCase):
        raise TypeError(case)
    scene = case.load()
    run = tl.simulate(scene, SECONDS, accuracy=ACCURACY, samples_per_second=SAMPLES)
    exact, doubt = extended_reference(scene, run.t)
    peers = {}
    for name in ("scipy", "mujoco"):
        module = peer_module(name)
        task = task_of(scene, run.t)
        setting = module.usual_settings(task)[0]
        peers[f"{NAMES[name]}, {setting}"] = module.prepare(task, setting)().track.q
    figure, ((angles, errors),) = new_figure(1, 2, size=(6.2, 3.9), sharex=True)
    angles.plot(run.t, run.q[:, 1], color=COLOURS[0], linewidth=4, alpha=0.5)
    errors.semilogy(run.t, run.error, color=COLOURS[0], linewidth=2.5)
    errors.semilogy(run.t[1:], _error(run.q, exact)[1:], color=COLOURS[0], linewidth=0.8)
    for (label, q), colour in zip(peers.items(), (COLOURS[5], COLOURS[1]), strict=True):
        angles.plot(run.t, q[:, 1], color=colour, linewidth=1.4)
        errors.semilogy(run.t[1:], np.maximum(_error(q, exact), 1e-12)[1:], color=colour, linewidth=1.2)
        print(f"{label}: error at the end {_error(q, exact)[-1]:.2g} rad")
    print(f"twolink: bar {run.error.max():.1e}, true {_error(run.q, exact).max():.1e}, truth {doubt.max():.0e} rad")
    angles.set(ylim=(-17, 19), title="elbow (rad)")
    errors.set(ylim=(1e-12, 1e5), title="error (rad)")
    labels: tuple[tuple[Any, float, float, str, int], ...] = (
        (angles, 8.3, -8, "twolink", 0), (angles, 8.7, 15.5, "SciPy", 5), (angles, 7.4, 6, "MuJoCo", 1),
        (errors, 9.8, 1e3, "SciPy and MuJoCo", 5), (errors, 9.8, 5e-6, "twolink's error bar", 0),
        (errors, 10.3, 1.5e-11, "its true error", 0),
    )  # fmt: skip
    for axis, x, y, text, k in labels:
        axis.text(x, y, text, color=COLOURS[k], fontsize=SIZE, horizontalalignment="right")
        axis.set_xlabel("time (s)", fontsize=SIZE)
        axis.title.set_fontsize(SIZE)
        axis.tick_params(labelsize=SIZE)
    PICTURE.parent.mkdir(exist_ok=True)
    print(save_figure(figure, PICTURE))


def _error(q: np.ndarray, exact: np.ndarray) -> np.ndarray:
    return np.abs(q - exact).max(axis=1).astype(float)


if __name__ == "__main__":
    main()
