"""What becomes of a store: status, figures, tables, and studies."""

import csv
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from twolink.errors import SceneError, ShowError
from twolink.parts.sweeps.results import _colours, _edges, column, turns_of
from twolink.parts.sweeps.sweeping import SweepStudy, bundled_studies
from twolink.sweeps import load_study, open_sweep, plot_sweep, run_study, study_of, sweep_status, write_sweep_table

pytest.importorskip("zarr")
ARM = tl.load_scene("arm-swing")
HERE = ThreadPoolExecutor(1)
VARY = {"q.elbow": [-0.4, 0.1, 0.5], "forearm.mass": [1.0, 1.5, -1.0], "accuracy": [1e-3, 1e-6]}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep over three quantities, of which a third failed."""
    out = tmp_path_factory.mktemp("sweep") / "x.zarr"
    tl.sweep(ARM, vary=VARY, out=out, duration=0.5, executor=HERE, outputs=["final", "cost"])
    return out


def test_status_counts_runs_and_tells_the_rate(store: Path, tmp_path: Path) -> None:
    found = sweep_status(store)
    assert (found.total, found.pending, found.done, found.failed) == (18, 0, 12, 6)
    assert "18 of 18 runs finished" in str(found)

    def stop(done: int, *_: object) -> None:
        if done == 4:
            raise KeyboardInterrupt

    tl.sweep(ARM, vary={"q.elbow": np.linspace(0, 1, 8)}, out=tmp_path / "y.zarr", duration=0.1, chunk=2, executor=HERE,
             progress=stop)  # fmt: skip
    for i, file in enumerate(sorted((tmp_path / "y.zarr/status/c").iterdir())):
        os.utime(file, (100.0 + 4 * i, 100.0 + 4 * i))
    part = sweep_status(tmp_path / "y.zarr")
    assert (part.pending, part.done, part.rate, part.seconds_left) == (4, 4, 0.5, 8.0)
    with pytest.raises(SceneError, match="no store"):
        sweep_status(tmp_path)


def test_it_opens_lazily(store: Path) -> None:
    data = open_sweep(store)
    assert not data["q"].variable._in_memory
    assert data["error"].attrs["units"] == "rad or m"


def test_figures_of_one_and_two_quantities(store: Path, tmp_path: Path) -> None:
    data = open_sweep(store)
    few = data.sel(accuracy=1e-6)
    curve = plot_sweep(few.sel({"q.elbow": 0.1}), tmp_path / "curve.svg", "end.q.elbow").read_text()
    assert "failed" in curve
    assert "forearm.mass, kg" in curve
    assert "2 runs" not in curve
    page = plot_sweep(few, tmp_path / "map.svg").read_text()
    assert plot_sweep(few).axes[0].get_title().startswith("9 runs")
    assert "9 runs; grey: 33.3%" in page
    assert "end.q.shoulder" in page
    for options, kind, part in (({"data": data}, ShowError, "3 quantities vary"),
                                ({"data": few, "variable": "erro"}, SceneError, "did you mean 'error'"),
                                ({"data": few, "variable": "reason"}, SceneError, "the sweep has no number 'reason'"),
                                ({"data": few, "variable": "error", "turns": True}, SceneError, "is no angle"),
                                ({"data": few, "variable": "t", "turns": True}, SceneError, "no angle")):  # fmt: skip
        with pytest.raises(kind, match=part):
            plot_sweep(**{"path": tmp_path / "no.svg", **options})


def test_names_and_decades_keep_their_places_on_the_axes(tmp_path: Path) -> None:
    vary = {"robot": ["two_link", "double_pendulum"], "accuracy": [1e-2, 1e-4, 1e-6]}
    data = tl.sweep(ARM, vary=vary, out=tmp_path / "r.zarr", duration=0.1, executor=HERE, outputs=["cost"])
    page = plot_sweep(data, tmp_path / "map.svg", "seconds").read_text()
    assert "two_link" in page
    assert "double_pendulum" in page
    edges = _edges(np.array([1e-6, 1e-4, 1e-2]))
    np.testing.assert_allclose(edges, [1e-7, 1e-5, 1e-3, 1e-1], rtol=1e-12)
    np.testing.assert_allclose(_edges(np.array([0.0, 1.0, 2.0])), [-0.5, 0.5, 1.5, 2.5])


def test_robots_in_a_list_have_places_and_one_run_has_no_figure(store: Path, tmp_path: Path) -> None:
    vary = {"robot": ["two_link", "double_pendulum", "two_link"], "accuracy": [1e-3, 1e-4, 1e-6]}
    data = tl.sweep(ARM, vary=vary, design="list", out=tmp_path / "x.zarr", duration=0.1, executor=HERE,
                    outputs=["cost"])  # fmt: skip
    (axis, _) = plot_sweep(data, variable="steps").axes
    across = axis.get_xlabel() == "robot"
    labels = axis.get_xticklabels() if across else axis.get_yticklabels()
    assert [label.get_text() for label in labels] == ["two_link", "double_pendulum"]
    np.testing.assert_array_equal(axis.collections[0].get_offsets()[:, 0 if across else 1], [0, 1, 0])
    with pytest.raises(ShowError, match="nothing varies"):
        plot_sweep(open_sweep(store).isel({"q.elbow": 0, "forearm.mass": 0, "accuracy": 0}))


def test_a_few_extreme_values_do_not_take_the_colours_of_the_others() -> None:
    values = np.append(np.linspace(-1.0, 1.0, 999), 100.0)
    low, high, beyond = _colours(values)
    assert (-1.0 <= low < -0.9, 0.9 < high <= 1.0, beyond) == (True, True, "both")
    assert _colours(np.array([[0.0, np.nan], [3.0, 1.0]])) == (0.0, 3.0, "neither")
    assert _colours(np.array([0.0] * 999 + [5.0])) == (0.0, 5.0, "neither")


def test_turns_that_the_error_bar_does_not_decide_are_left_out(store: Path, tmp_path: Path) -> None:
    data = open_sweep(store).sel(accuracy=1e-6, drop=True).isel({"q.elbow": 0}).load()
    data["q"].values[:, 1] = [2 * np.pi + 3.0, 2 * np.pi + 3.0, 6 * np.pi]
    data["error"].values[:] = [0.1, 0.2, 0.1]  # the next half turn is 0.1416 away
    data["status"].values[:] = 1
    turns, sure = turns_of(data, "end.q.elbow")
    assert turns.tolist() == [1.0, 1.0, 3.0]
    assert sure.tolist() == [True, False, True]
    assert plot_sweep(data, tmp_path / "turns.png", "end.q.elbow", turns=True).stat().st_size > 5000


def test_a_slider_has_no_turns(tmp_path: Path) -> None:
    scene = tl.Scene(tl.load_robot("gripper"))
    data = tl.sweep(scene, vary={"q.lift": [0.0, 0.1]}, out=tmp_path / "p.zarr", duration=0.01, executor=HERE)
    assert plot_sweep(data, variable="end.q.lift")
    with pytest.raises(SceneError, match=r"'end\.q\.lift' is no angle, which has turns"):
        plot_sweep(data, variable="end.q.lift", turns=True)


def test_tables_have_a_row_for_each_run(store: Path, tmp_path: Path) -> None:
    import pandas as pd

    data = open_sweep(store)
    with write_sweep_table(data, tmp_path / "x.csv").open(newline="") as file:
        from_csv = list(csv.DictReader(file))
    from_parquet = pd.read_parquet(write_sweep_table(data, tmp_path / "x.parquet")).to_dict("records")
    for rows in (from_csv, from_parquet):
        assert len(rows) == 18
        wanted = {"q.elbow": 0.5, "forearm.mass": 1.5, "accuracy": 1e-6}
        (row,) = (row for row in rows if all(float(row[name]) == value for name, value in wanted.items()))
        there = data.sel(wanted)
        assert float(row["end.q.elbow"]) == float(column(there, "end.q.elbow"))
        assert float(row["error"]) == float(there.error)
        failed = [row for row in rows if int(row["status"]) == 3]
        assert all("expected at least 0, got -1" in row["reason"] for row in failed)
        assert len(failed) == 6
    with pytest.raises(SceneError, match="not a format"):
        write_sweep_table(data, tmp_path / "x.xls")


def test_studies_come_with_twolink_or_as_files(tmp_path: Path) -> None:
    assert set(bundled_studies()) >= {"basin", "release", "price"}
    for name in bundled_studies():
        assert load_study(name).title
    path = tmp_path / "own.toml"
    path.write_text('scene = "arm-swing"\nduration = 0.1\ncount = 4\ndesign = "sobol"\n'
                    '[vary]\n"q.elbow" = { uniform = [-1.0, 1.0] }\n')  # fmt: skip
    data = run_study(study_of(str(path)), tmp_path / "x.zarr", executor=HERE)
    assert (data.status == 1).all()
    assert study_of("arm-swing") == SweepStudy("arm-swing", {})
    path.write_text('scene = "arm-swing"\nvary = {}\nacuracy = 1.0\n')
    with pytest.raises(SceneError, match="unknown field `acuracy`"):
        load_study(str(path))
    with pytest.raises(SceneError, match="did you mean 'basin'"):
        load_study("bassin")
