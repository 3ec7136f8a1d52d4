"""Draws docs/pictures/error-bar.png: a double pendulum by twolink with its error bar, and by peers at their defaults.

    python -m scripts.make.error_bar_picture          needs: pip install twolink[peers]

The errors are against a Taylor series in extended precision, whose own error is checked by a second one.
"""

import numpy as np

import twolink as tl
from scripts.runner import TOP, options
from twolink.hard import SimulationCase, select_cases
from twolink.hard.peers import NAMES, peer_module
from twolink.hard.peers.task import task_of
from twolink.hard.truths import extended_reference
from twolink.show.figure import COLOURS, new_figure, save_figure

SECONDS, SAMPLES, ACCURACY = 10.0, 100, 1e-6
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
    figure, axes = new_figure(1, 3, size=(11, 3.9), width_ratios=[0.9, 1.3, 1.3])
    arms, angles, errors = axes[0]
    _draw_arms(arms, {"twolink": run.q, **peers}, run.t)
    angles.plot(run.t, run.q[:, 1], color=COLOURS[0], linewidth=4, alpha=0.5, label="twolink")
    errors.semilogy(run.t, run.error, color=COLOURS[0], linewidth=2.5, label="twolink's error bar")
    errors.semilogy(run.t[1:], _error(run.q, exact)[1:], color=COLOURS[0], linewidth=0.8, label="its true error")
    for (label, q), colour in zip(peers.items(), (COLOURS[5], COLOURS[1]), strict=True):
        angles.plot(run.t, q[:, 1], color=colour, linewidth=1.2, label=label)
        errors.semilogy(run.t[1:], np.maximum(_error(q, exact), 1e-12)[1:], color=colour, linewidth=1.2)
        print(f"{label}: error at the end {_error(q, exact)[-1]:.2g} rad")
    print(f"twolink: bar {run.error.max():.1e}, true {_error(run.q, exact).max():.1e}, truth {doubt.max():.0e} rad")
    angles.set(xlabel="time (s)", ylabel="elbow (rad)", title="the blue curve is the motion")
    angles.legend(frameon=False, fontsize=8, loc="lower left")
    errors.set(xlabel="time (s)", ylabel="error (rad)", ylim=(1e-12, 1e2), title="and its error bar says how well")
    errors.legend(frameon=False, fontsize=8, loc="lower right")
    PICTURE.parent.mkdir(exist_ok=True)
    print(save_figure(figure, PICTURE))


def _error(q: np.ndarray, exact: np.ndarray) -> np.ndarray:
    return np.abs(q - exact).max(axis=1).astype(float)


def _draw_arms(axis, motions: dict[str, np.ndarray], t: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    """The arms at the end, with the last third of a second of their tips."""
    recent = t >= t[-1] - 0.35
    for (_, q), colour, width in zip(motions.items(), (COLOURS[0], COLOURS[5], COLOURS[1]), (7, 3, 3), strict=True):
        absolute = q.sum(axis=1)
        elbow = np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)
        tip = elbow + np.stack([np.cos(absolute), np.sin(absolute)], axis=1)
        axis.plot(*tip[recent].T, color=colour, linewidth=1, alpha=0.6)
        axis.plot(*np.stack([np.zeros(2), elbow[-1], tip[-1]]).T, color=colour, linewidth=width, alpha=0.8,
                  solid_capstyle="round")  # fmt: skip
    axis.plot(0, 0, "o", color="0.2", markersize=9)
    axis.set(aspect="equal", xlim=(-2.1, 2.1), ylim=(-2.1, 2.1), xlabel="x (m)", ylabel="z (m)",
             title=f"one robot, one start, after {t[-1]:g} s")  # fmt: skip


if __name__ == "__main__":
    main()
