"""Notebooks: the example runs in a kernel, and what it ends its cells with shows itself."""

import base64
import os
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

import twolink as tl
from tests.command import TOP

EXAMPLE = TOP / "docs" / "tutorials" / "notebook.ipynb"


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What each cell of the example shows, by kind, by the last line of the cell."""
    notebook = nbformat.read(EXAMPLE, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells)  # the file has no results that may be stale
    place = tmp_path_factory.mktemp("notebook")
    environment = {**os.environ, "PYTHONPATH": str(TOP), "IPYTHONDIR": str(place), "MPLBACKEND": "agg"}
    resources = {"metadata": {"path": str(place)}}
    NotebookClient(notebook, timeout=120, resources=resources).execute(env=environment, cwd=str(place))
    found = {}
    for cell in (cell for cell in notebook.cells if cell.cell_type == "code"):
        name = cell.source.splitlines()[-1]
        for output in cell.outputs:
            found[name if output["output_type"] == "execute_result" else f"progress of {name}"] = output["data"]
    return found


@pytest.mark.slow
def test_robots_and_scenes_are_tables(shown: dict[str, dict[str, Any]]) -> None:
    assert "<table>" in shown["robot"]["text/html"]
    assert "The arm swings, and its elbow is damped" in shown["scene"]["text/html"]


@pytest.mark.slow
def test_a_run_is_a_table_with_its_curves(shown: dict[str, dict[str, Any]]) -> None:
    html = shown["run"]["text/html"]
    assert "<caption>The arm swings, and its elbow is damped</caption>" in html
    assert float(re.search(r"at most (\S+) rad", html).group(1)) <= 1e-9
    picture = re.search(r'src="data:image/png;base64,([^"]+)"', html)
    assert picture is not None
    assert base64.b64decode(picture.group(1)).startswith(b"\x89PNG")
    assert base64.b64decode(shown["figure"]["image/png"]).startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_playback_is_a_frame_with_the_page(shown: dict[str, dict[str, Any]]) -> None:
    html = shown["run.playback()"]["text/html"]
    assert html.startswith('<iframe srcdoc="&lt;!DOCTYPE html&gt;')
    assert html.count("<") == 2  # all of the page is escaped


def test_a_study_is_text_with_its_figure(shown: dict[str, dict[str, Any]]) -> None:
    html = shown["study"]["text/html"]
    assert "dop853" in html
    assert "data:image/png" in html


@pytest.mark.slow
def test_long_work_has_a_bar(shown: dict[str, dict[str, Any]]) -> None:
    bar = re.fullmatch(r'<progress value="(\d+)" max="(\d+)"></progress> done', shown["progress of study"]["text/html"])
    assert bar is not None
    assert bar.group(1) == bar.group(2)


@pytest.mark.slow
def test_an_untitled_run_without_an_error_bar_shows_itself(tmp_path: Path) -> None:
    run = tl.simulate(tl.Scene(tl.load_robot("two_link")), 0.1, verify=False)
    assert "not verified" in run._repr_html_()
    again = tl.Trajectory.load(run.save(tmp_path / "x.npz"))
    assert "not verified" in again._repr_html_()
