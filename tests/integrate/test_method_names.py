"""Names of methods that other programs use."""

import numpy as np
import pytest

import twolink as tl
from twolink.errors import SceneError
from twolink.integrate.steps.methods import ELSEWHERE, METHODS


@pytest.mark.parametrize(("name", "ours"), ELSEWHERE.items())
def test_a_name_from_elsewhere_is_the_method_here_and_the_run_says_so(name: str, ours: str) -> None:
    setting = {"tolerance": 1e-6} if METHODS[ours].adaptive else {"step": 0.01}
    runs = [tl.simulate(tl.load_scene("arm-swing"), 0.1, method=one, verify=False, **setting) for one in (name, ours)]
    np.testing.assert_array_equal(runs[0].q, runs[1].q)
    for run, said in zip(runs, (True, False), strict=True):
        assert run.cost.method == ours
        assert (f"asked for as {name}" in str(run.cost)) == said


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(SceneError, match="'ode44' is unknown"):
        tl.simulate(tl.load_scene("arm-swing"), 0.1, method="ode44")
