"""One run of a sweep as a scene of its own, to be simulated again and looked at."""

from typing import Any

import numpy as np

from twolink.errors import SceneError
from twolink.scenes import Scene
from twolink.scenes.parameters import scene_with
from twolink.sweeps.design import Design
from twolink.sweeps.quantities import run_inputs, variant
from twolink.sweeps.runs import groups


def run_scene(
    scene: Scene, design: Design, accuracy: float, duration: float, number: int
) -> tuple[Scene, float, dict[str, Any]]:
    """The scene of one run, its accuracy, and what varies.

    Parameters
    ----------
    scene : Scene
        That of the sweep.
    design : Design
        Its runs, of `make_design`.
    accuracy, duration : float
        Of the sweep: rad or m, s.
    number : int
        The run in C order: the last dimension changes fastest.

    Raises
    ------
    SceneError
        There is no such run, or it cannot be made into a scene (its row in the store has the same reason).
    """
    if not 0 <= number < design.runs:
        raise SceneError(f"there is no run {number}", argument="run", remedy=f"0 to {design.runs - 1}")
    at = np.unravel_index(number, design.shape)
    values = design.in_block(tuple(slice(i, i + 1) for i in at))
    of, _ = next(groups(accuracy, design.quantities, values))
    own = run_inputs(variant(scene, of.off, of.robot), of.off, of.accuracy, design.quantities, values)
    changed = scene_with(own.scene, {name: float(numbers[0]) for name, numbers in own.parameters.items()})
    made = Scene(changed.base, own.q[0], own.v[0], changed.effects, duration, scene.title)
    return made, of.accuracy, {name: numbers.tolist()[0] for name, numbers in values.items()}
