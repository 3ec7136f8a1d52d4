"""explain is quick: it measures an evaluation without compiling steps that take long to compile."""

import pytest

import twolink as tl
from twolink.dynamics.kernels import heyoka


@pytest.mark.slow
@pytest.mark.skipif(heyoka() is None, reason="without heyoka nothing is compiled")
def test_an_evaluation_is_measured_without_steps_that_compile_long(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("whole steps are compiled")

    monkeypatch.setenv("TWOLINK_CACHE", "off")
    monkeypatch.setattr("twolink.integrate.steps.compiled_functions._kept", {})
    monkeypatch.setattr("twolink.integrate.steps.step_map.compiled_map", refuse)
    explained = tl.explain(tl.load_scene("squeezer"))
    assert explained.nanoseconds is not None
    batch, alone = explained.nanoseconds
    assert 0 < batch < alone  # a batch uses whole vectors
    assert "(measured)" in str(explained)
