"""Error bars hold on random scenes, against the reference of scripts/honest_bars.py."""

import numpy as np
import pytest
from honest_bars import true_error
from random_robots import random_scene

import twolink as tl
from twolink.errors import AccuracyError


@pytest.mark.parametrize("seed", range(15))
def test_the_error_bar_holds_at_every_sample(seed: int) -> None:
    """2 degrees of freedom, sometimes 3; 1 to 4 s, method "auto"; the best run of a refusal has a true bar as well."""
    random = np.random.default_rng([77, seed])
    scene, name = random_scene(random, {2: 0.87, 3: 0.13}, floating=0.0)
    accuracy = float(10 ** random.uniform(-10, -3))
    try:
        run = tl.simulate(scene, float(random.uniform(1, 4)), accuracy, samples=20)
    except AccuracyError as error:
        run = error.run
    else:
        assert run.error is not None
        assert run.error[-1] <= accuracy
    true, reference = true_error(run, scene, quad=False)
    assert run.error is not None
    sure = reference <= 0.1 * run.error
    sure[0] = False  # the start is not computed
    assert sure[1:].mean() > 0.9, name
    assert np.all(true[sure] <= run.error[sure]), (name, (true[1:] / run.error[1:]).max())
