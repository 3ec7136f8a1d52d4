"""Saved scenes are read again unchanged; the bundled scenes satisfy the schema."""

import tomllib
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from twolink import effects as fx
from twolink.errors import QueryError, SceneError
from twolink.lagrange.check import arm_urdf
from twolink.scenes.file import bundled_scenes
from twolink.scenes.file_format import scene_schema


def same(a: tl.Scene, b: tl.Scene) -> None:
    assert a.effects == b.effects
    assert (a.duration, a.title) == (b.duration, b.title)
    np.testing.assert_array_equal(a.q, b.q)
    np.testing.assert_array_equal(a.v, b.v)
    np.testing.assert_array_equal(a.robot.mass_matrix(a.q), b.robot.mass_matrix(b.q))


def test_a_saved_scene_is_read_again_unchanged(tmp_path: Path) -> None:
    robot = tl.load_robot("panda", lock={"panda_finger_joint1": 0.01, "panda_finger_joint2": 0.0})
    effects = [
        fx.Gravity((0.1, 0.0, -1 / 3)),
        fx.JointDamping(),
        fx.Torque({"panda_joint3": fx.Sine(1.0, 2.0), "panda_joint1": 0.1}),
    ]
    q, v = np.linspace(0.1, 0.7, 7) / 3, np.full(7, 0.2)
    scene = tl.Scene(robot, q=q, v=v, effects=effects, duration=1.5, title='a "b"')
    same(scene, tl.load_scene(scene.save(tmp_path / "scene.toml")))
    same(scene, tl.load_scene(scene.save(tmp_path / "other.TOML")))


def test_a_robot_outside_the_catalogue_is_saved_beside_the_scene(tmp_path: Path) -> None:
    scene = tl.Scene(tl.load_robot(arm_urdf(1, 2, 3, 4)), q=[0.1, 0.0])
    saved = scene.save(tmp_path / "mine.toml")
    assert (tmp_path / "mine.urdf").exists()
    same(scene, tl.load_scene(saved))


def test_a_floating_robot_keeps_its_quaternion(tmp_path: Path) -> None:
    robot = tl.load_robot("ur5", root="free")
    q = robot.neutral
    q[3:7] = [0.5, 0.5, 0.5, 0.5]
    scene = tl.Scene(robot, q=q, v=np.arange(robot.nv) / 7)
    same(scene, tl.load_scene(scene.save(tmp_path / "free.toml")))


def test_saving_does_not_overwrite_another_urdf(tmp_path: Path) -> None:
    """A scene gets the name of its robot's own file: the original stays, and so does another file of that name."""
    original, taken = tmp_path / "mine.urdf", tmp_path / "mine-robot.urdf"
    original.write_text(arm_urdf(1, 2, 3, 4) + "<!-- mine -->")
    scene = tl.Scene(tl.load_robot(original), q=[0.1, 0.0])
    same(scene, tl.load_scene(scene.save(tmp_path / "mine.toml")))
    same(scene, tl.load_scene(scene.save(tmp_path / "mine.toml")))
    assert original.read_text().endswith("<!-- mine -->")
    taken.write_text("something else")
    with pytest.raises(SceneError, match="another file"):
        scene.save(tmp_path / "mine.toml")
    assert taken.read_text() == "something else"


def test_a_controller_in_python_is_named_as_the_cause_and_saves_its_run(tmp_path: Path) -> None:
    control = fx.Controller(lambda _t, y, state: (-y.v, state))
    scene = tl.Scene(tl.load_robot("two_link"), effects=[control], duration=0.01)
    assert "effects   Controller (every 0.001 s)" in str(scene)
    with pytest.raises(SceneError, match="Controller calls Python at its ticks") as caught:
        scene.save(tmp_path / "scene.toml")
    assert "save its run" in caught.value.remedy
    assert tl.simulate(scene).save(tmp_path / "run.npz").exists()


@pytest.mark.parametrize("path", [None, 3])
@pytest.mark.parts
def test_what_is_no_path_is_refused_by_all_that_write(path: Any) -> None:
    scene = tl.load_scene("arm-swing")
    run = tl.simulate(scene, 0.01)
    writers: list[Callable[[Any], object]] = [scene.save, scene.export_fmu, scene.robot.export_urdf,
                                              scene.robot.export_c, scene.robot.export_mjcf, run.save,
                                              lambda path: tl.export(run, path)]  # fmt: skip
    for write in writers:
        with pytest.raises(QueryError, match="expected the path of a file"):
            write(path)


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"\.json is no format"):
        tl.load_scene("arm-swing").save(tmp_path / "scene.json")


def test_the_schema_knows_every_effect_and_the_bundled_scenes_satisfy_it() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = scene_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    for name in bundled_scenes():
        text = (resources.files("twolink.scenes") / "bundled" / f"{name}.toml").read_text(encoding="utf-8")
        assert not list(validator.iter_errors(tomllib.loads(text))), name
    assert list(validator.iter_errors({"robot": "arm", "effects": [{"type": "gravty"}]}))
    assert list(validator.iter_errors({"robot": "arm", "durtion": 1.0}))


def test_the_schema_says_what_each_field_of_an_effect_is() -> None:
    """Forms and editors show it: the equation of the effect, and quantity and unit of each field."""
    definitions = scene_schema()["$defs"]
    friction = definitions["DryFriction"]
    assert "tau_k = -c_k sign(v_k)" in friction["description"]
    assert "Parameters" not in friction["description"]
    assert friction["properties"]["static"]["description"] == "s, N m or N, not below c; c by default."
    assert definitions["Payload"]["properties"]["frame"]["format"] == "link"
    driven = [part["properties"]["of"]["description"] for part in definitions.values() if "of" in part["properties"]]
    assert sum("What drives the motor;" in text for text in driven) == 1  # each is told of its own
    effects = [part for part in definitions.values() if "type" in part.get("properties", {})]
    assert len(effects) > 20
    bare = [f"{part['title']}.{name}" for part in effects for name, field in part["properties"].items()
            if name != "type" and not field.get("description")]  # fmt: skip
    assert bare == []


def test_joints_that_follow_others_are_not_saved_as_free_ones(tmp_path: Path) -> None:
    scene = tl.Scene(tl.load_robot("panda", mimic=True))
    with pytest.raises(SceneError, match="no joints that follow others"):
        scene.save(tmp_path / "scene.toml")
