"""Draws docs/arm-swing.png, the README's picture: the paper's release, as a strobe and as curves of both models.

python scripts/readme_picture.py
"""

import argparse
from pathlib import Path

import numpy as np

import twolink as tl
from twolink.paper.figures import by_hand
from twolink.show.figure import COLOURS, new_figure, save_figure

SECONDS = 2.48  # about one cycle


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    run = tl.simulate(tl.load_scene("arm-swing"), SECONDS, accuracy=1e-9, samples=1200 / SECONDS)
    hand = by_hand(1.0, SECONDS)
    figure, axes = new_figure(1, 2, size=(10, 4.2), width_ratios=[1, 1.25])
    strobe, curves = axes[0]
    elbow = np.stack([np.cos(run.q[:, 0]), np.sin(run.q[:, 0])], axis=1)
    absolute = run.q.sum(axis=1)
    tip = elbow + np.stack([np.cos(absolute), np.sin(absolute)], axis=1)
    half = run.t <= SECONDS / 2
    strobe.plot(*tip[half].T, color="0.75", linewidth=1)
    for i in np.flatnonzero(half)[::50]:
        links = np.stack([np.zeros(2), elbow[i], tip[i]])
        strobe.plot(*links[:2].T, color=COLOURS[0], linewidth=4, alpha=0.35, solid_capstyle="round")
        strobe.plot(*links[1:].T, color=COLOURS[1], linewidth=3, alpha=0.5, solid_capstyle="round")
    strobe.plot(0, 0, "o", color="0.2", markersize=9)
    strobe.set(aspect="equal", xlabel="x (m)", ylabel="z (m)", title="released from the horizontal, half a cycle")
    for joint, name in enumerate(("shoulder", "elbow")):
        label = f"{name}, URDF + Pinocchio"
        curves.plot(run.t, run.q[:, joint], color=COLOURS[joint], linewidth=4, alpha=0.45, label=label)
        curves.plot(hand.t, hand.theta[:, joint], color="0", linewidth=1, label="by hand" if joint else None)
    difference = np.abs(run.q - hand.theta).max()
    curves.set(xlabel="time (s)", ylabel="angle (rad)", title=f"two ways to the same motion, to {difference:.0e} rad")
    curves.legend(frameon=False, fontsize=9)
    print(save_figure(figure, Path(__file__).parents[1] / "docs" / "arm-swing.png"))


if __name__ == "__main__":
    main()
