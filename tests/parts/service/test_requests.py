"""Requests for jobs: the id of a job is that of a result, which depends on the request and on the code."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import twolink as tl
from twolink.errors import SceneError
from twolink.io import fingerprints
from twolink.parts.service.store.archives import write_robot
from twolink.parts.service.work import requests, scene_tasks
from twolink.scenes.file_format import ObjectEntry, SceneFile


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder in place of the package, whose code is read again in each `key`."""
    (tmp_path / "simulation").mkdir()
    monkeypatch.setattr(fingerprints, "PACKAGE", tmp_path)
    yield tmp_path
    forget()


def forget() -> None:
    requests.version_key.cache_clear()
    fingerprints.code_key.cache_clear()


def key(body: bytes = b'{"scene": "arm-swing", "wait": 1}') -> str:
    forget()
    return requests.prepare(kind="simulation", body=body).key


def test_results_of_other_code_scenes_or_libraries_are_not_given(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, scene = package / "simulation" / "error_bar.py", package / "arm.toml"
    code.write_text("SAFETY = 2.0")
    keys = [key()]
    assert key() == key(b'{"wait": 9, "scene": "arm-swing"}') == keys[0]
    code.write_text("SAFETY = 3.0")
    keys.append(key())
    scene.write_text("duration = 1.0")
    keys.append(key())
    monkeypatch.setattr(fingerprints, "versions", lambda names: dict.fromkeys(names, "99"))
    keys.append(key())
    assert len(set(keys)) == 4


def test_objects_of_a_scene_are_joined_once_and_read_no_files() -> None:
    entries = [ObjectEntry("can", (0.0, 0.0, 1.0)), ObjectEntry(tl.effects.Box((1, 1, 0.1)), name="table")]
    asked = SceneFile("world", objects=entries)
    scene = scene_tasks.scene_of(asked, "")
    again = scene_tasks.scene_of(asked, "", write_robot(scene.base))
    assert scene.base.frame_names == again.base.frame_names == ("world", "can", "table")
    assert scene.q.tolist() == again.q.tolist() == [0, 0, 1, 0, 0, 0, 1]
    with pytest.raises(SceneError, match=r"files are not read here: 'a\.stl'"):
        scene_tasks.scene_of(SceneFile("world", objects=[ObjectEntry("a.stl", mass=1.0)]), "")
    with pytest.raises(SceneError, match="201 objects, the limit is 200"):
        scene_tasks.scene_of(SceneFile("world", objects=entries[:1] * 201), "")


def test_kept_results_are_of_the_simulators_of_now(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert package.is_dir()
    keys = []
    for number in ("3.3.0", "3.4.0"):
        monkeypatch.setattr(requests, "versions", lambda names, number=number: dict.fromkeys(names, number))
        keys.append(key(b'{"scene": "arm-swing", "simulator": "mujoco"}'))
    assert keys[0] != keys[1]
