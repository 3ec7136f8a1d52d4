"""Error bars hold on random scenes: smooth ones against Taylor series of 19 digits, others against closed forms.

scripts/studies/error_bars.py is the study over all kinds of scenes; here are some of them, and how it keeps its rows.
"""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from scripts.runner import collect, print_bars, read_rows
from scripts.studies.error_bars import SAMPLES, Row, check, show
from scripts.studies.scenes.exact import KINDS, WORLDS
from scripts.studies.scenes.robots import random_scene
from twolink.errors import AccuracyError
from twolink.hard.truths import distance, extended_reference


@pytest.mark.some(5)
@pytest.mark.parametrize("seed", range(15))
def test_the_error_bar_holds_at_every_sample(seed: int) -> None:
    """2 degrees of freedom, sometimes 3; 1 to 4 s, method "auto"; the best run of a refusal has a true bar as well."""
    random = np.random.default_rng([77, seed])
    scene, name = random_scene(random, {2: 0.87, 3: 0.13}, floating=0.0)
    accuracy = float(10 ** random.uniform(-10, -3))
    try:
        run = tl.simulate(scene, float(random.uniform(1, 4)), accuracy=accuracy, samples_per_second=20)
    except AccuracyError as error:
        run = error.run
    else:
        assert run.error is not None
        assert run.error[-1] <= accuracy
    reference, doubt = extended_reference(scene, run.t)
    true = distance(scene.robot, run.q.astype(np.longdouble), reference)
    assert run.error is not None
    sure = doubt <= 0.1 * run.error
    sure[0] = False  # the start is not computed
    assert sure[1:].mean() > 0.9, name
    assert np.all(true[sure] <= run.error[sure]), (name, (true[1:] / run.error[1:]).max())


def test_the_study_goes_on_where_it_was_interrupted(tmp_path: Path) -> None:
    path, checked = tmp_path / "rows.csv", []

    def rows_until(last: int) -> list[Row]:
        def one(number: int) -> list[Row]:
            if number == last:
                raise KeyboardInterrupt
            checked.append(number)
            return [Row(number, KINDS[number], "a, b", "taylor", 1e-6, "kept", 60, 1, 0.5, total_seconds=0.1)]

        return collect(path, Row, range(5), one)

    with pytest.raises(KeyboardInterrupt):
        rows_until(3)
    with path.open("a") as file:
        file.write("3,long,half a ro")
    rows = rows_until(9)
    assert checked == [0, 1, 2, 3, 4]
    assert [row.scene for row in rows] == [0, 1, 2, 3, 4]
    assert rows == read_rows(path, Row)
    assert all(row.fails for row in rows)
    assert not print_bars(show(rows))


@pytest.mark.slow
def test_error_bars_of_many_random_scenes(tmp_path: Path) -> None:
    """By the last digit: 2 and 3 start beside saddles, 4 are long, 5 loops, 6 events, 8 worlds, 9 between samples.

    Two scenes more of each kind than a block has, so that two blocks of robots are tried.
    """
    rows = collect(tmp_path / "rows.csv", Row, range(64), lambda number: [check(number, 1)])
    show(rows)
    assert not [row for row in rows if row.fails]
    whole = [row for row in rows if row.kind != "limit"]  # a run that reaches its limit of accuracy may end before
    assert all(row.samples == (WORLDS if row.kind == "worlds" else SAMPLES) for row in whole)
