"""The command optimize: a table or JSON, files of the best scene and its run, and misuse."""

from pathlib import Path

import pytest

import twolink as tl
from tests.command import answer, call, one_line

ARGUMENTS = ("optimize", "arm-swing", "--wrt", "v.elbow=-2:2", "--duration", "0.4", "--starts", "2")


@pytest.mark.slow
def test_the_best_scene_is_written_and_gives_the_best_value(tmp_path: Path) -> None:
    out, keep = tmp_path / "best.toml", tmp_path / "search.json"
    limit = ("--at-most", "speed:forearm=3.95")
    files = ("--out", str(out), "--keep", str(keep))
    record = answer(*ARGUMENTS, "--objective", "z:forearm", "--maximize", *limit, *files)
    assert record["files"] == [str(out)]
    assert keep.exists()
    best = tl.load_scene(out)
    variable = record["variables"][0]
    assert best.v[1] == pytest.approx(variable["value"])
    assert abs(best.v[1]) > 0.1
    run = tl.simulate(best, 0.4)
    assert float(run.robot.frame_pose(run.q[-1], "forearm")[1][2]) == pytest.approx(record["objective"], abs=1e-6)
    assert record["constraints"]["speed:forearm=3.95"] == pytest.approx(0.0, abs=1e-6)
    assert record["simulations"] >= len(record["history"])


def test_the_table_is_for_people(tmp_path: Path) -> None:
    done = call(*ARGUMENTS, "--objective", "rest:elbow=0.1", "--out", str(tmp_path / "best.TOML"))
    assert done.returncode == 0
    assert tl.load_scene(tmp_path / "best.TOML").robot.name == "two_link"
    assert "objective" in done.stdout
    assert "v.elbow" in done.stdout
    assert "start 1: " in done.stdout


def test_misuse() -> None:
    one_line(call(*ARGUMENTS, "--objective", "hight:forearm"), 2, "there is no objective 'hight:forearm'")
    one_line(call(*ARGUMENTS[:2], "--wrt", "v.elbow=1", "--objective", "energy"), 2, "expected NAME=LOW:HIGH")
    one_line(call(*ARGUMENTS[:2], "--wrt", "v.elbo=0:1", "--objective", "energy"), 2, "did you mean 'v.elbow'")
