"""The command fit: a table or JSON, and the scene, URDF and figure found."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import answer, call, one_line
from twolink.io.tables import write_table
from twolink.scenes.parameters import scene_with

TRUE = {"forearm.mass": 1.8, "effects.1.damping.elbow": 0.3}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tl.simulate(scene_with(tl.load_scene("arm-human"), TRUE), 1.5, samples_per_second=50)
    q = run.q + 1e-3 * np.random.default_rng(0).standard_normal(run.q.shape)
    columns = {"t": run.t, "q.shoulder": q[:, 0], "q.elbow": q[:, 1]}
    return write_table(tmp_path_factory.mktemp("fit") / "log.csv", columns, {})


def test_values_intervals_and_files(log: Path, tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("found.toml", "found.urdf", "fit.png")]
    options = [part for path in files for part in ("--out", str(path))]
    record = answer("fit", "arm-human", str(log), "--parameters", ",".join(TRUE), *options)
    for row in record["found"]:
        assert row["value"] == pytest.approx(TRUE[row["parameter"]], rel=0.02)
    assert record["warnings"] == []
    mass = record["parameters"]["forearm.mass"]
    scene = tl.load_scene(files[0])
    assert scene.effects[1].damping["elbow"] == pytest.approx(record["parameters"]["effects.1.damping.elbow"])
    assert scene.robot.model.inertias[2].mass == pytest.approx(mass)
    assert "found: forearm.mass = " in files[1].read_text()
    assert tl.load_robot(files[1]).model.inertias[2].mass == pytest.approx(mass)
    assert files[2].stat().st_size > 10_000


def test_the_table_is_for_people_and_misuse_is_one_line(log: Path, tmp_path: Path) -> None:
    done = call("fit", "arm-human", str(log), "--parameters", "forearm.mass,forearm.com.y")
    assert "no measurement depends on: forearm.com.y" in done.stdout
    assert "95 % intervals" in done.stdout
    one_line(call("fit", "arm-human", str(log), "--parameters", "forarm.mass"), 2, "did you mean 'forearm.mass'")
    one_line(call("fit", "arm-human", str(log), "--parameters", "q", "--out", str(tmp_path / "a.txt")), 2, "format")
