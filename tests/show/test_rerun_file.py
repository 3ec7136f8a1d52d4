"""Recordings of Rerun, read by its own reader."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import twolink as tl
from twolink import effects as fx
from twolink.show.surfaces import surfaces

RrdReader = pytest.importorskip("rerun.chunk", reason="the extra `rerun` is not installed: half a gigabyte").RrdReader


def contents(path: Path) -> dict[str, dict[str, list]]:
    """The rows of each component by entity."""
    found: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            found.setdefault(chunk.entity_path, {})[name] = column.to_pylist()
    return found


def placed(entity: dict[str, list], row: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position of an entity."""
    quaternion = entity["Transform3D:quaternion"][row][0]
    return Rotation.from_quat(quaternion).as_matrix(), np.array(entity["Transform3D:translation"][row][0])


@pytest.fixture(scope="module")
def run() -> tl.Trajectory:
    robot = tl.load_robot("ur5", root="free")
    q = robot.integrate(robot.neutral, np.linspace(0.3, 0.9, robot.nv))
    return tl.simulate(tl.Scene(robot, q, np.linspace(1, 3, robot.nv), [fx.Gravity()]), 0.2, samples_per_second=50)


@pytest.mark.slow
def test_links_surfaces_and_curves(run: tl.Trajectory, tmp_path: Path) -> None:
    found, k = contents(run.save(tmp_path / "x.rrd")), 7
    robot, visuals = run.robot, run.robot.visual_model()
    for link in robot.frame_names:
        expected = robot.frame_pose(run.q[k], link)
        for value, right in zip(placed(found[f"/robot/{link}"], k), expected, strict=True):
            np.testing.assert_allclose(value, right, atol=1e-6)  # Rerun keeps single precision
    curves = {"/q/elbow_joint": run.columns()["q.elbow_joint"], "/error": run.error, "/energy": run.energy}
    for name, values in curves.items():
        np.testing.assert_array_equal([row[0] for row in found[name]["Scalars:scalars"]], values)
        assert [time.total_seconds() for time in found[name]["time"]] == pytest.approx(run.t, abs=1e-6)
    data, geometry = robot.model.createData(), visuals.createData()
    pin.updateGeometryPlacements(robot.model, data, visuals, geometry, run.q[k])
    drawn = surfaces(visuals)[0]
    assert len(drawn) > 5
    for surface in drawn:
        item = visuals.geometryObjects[surface.index]
        (name,) = (name for name in found if name.endswith(f"/{item.name}"))
        (turn, shift), (link_turn, link_shift) = placed(found[name], 0), placed(found[name.rpartition("/")[0]], k)
        corners = np.array(found[name]["Mesh3D:vertex_positions"][0][:300])
        right = surface.triangles.reshape(-1, 3)[:300] @ geometry.oMg[surface.index].rotation.T
        np.testing.assert_allclose((corners @ turn.T + shift) @ link_turn.T + link_shift,
                                   right + geometry.oMg[surface.index].translation, atol=1e-6)  # fmt: skip


def test_names_of_any_letters(tmp_path: Path) -> None:
    robot = tl.load_robot("""<robot name="r"><link name="world"/><link name="a b/c"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial><visual><geometry><box size="1 1 1"/></geometry>
</visual></link><joint name="j.1/ü" type="continuous"><parent link="world"/><child link="a b/c"/></joint></robot>""")
    run = tl.simulate(tl.Scene(robot, robot.neutral, [1.0], [fx.Gravity()]), 0.1)
    found = contents(run.save(tmp_path / "x.rrd"))
    assert any("Mesh3D:vertex_positions" in entity for entity in found.values())
    assert sum("Scalars:scalars" in entity for entity in found.values()) == len(run.columns()) - 1
    assert tl.Trajectory.load(run.save(tmp_path / "x.mcap"), robot).q == pytest.approx(run.q, abs=1e-15)
