"""explain is quick, and measures an evaluation."""

import twolink as tl


def test_an_evaluation_is_measured() -> None:
    explained = tl.explain(tl.load_scene("squeezer"))
    assert explained.nanoseconds is not None
    batch, alone = explained.nanoseconds
    assert 0 < batch < alone  # a batch uses whole vectors
    assert "(measured)" in str(explained)
