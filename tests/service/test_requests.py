"""Requests for jobs: the id of a job is that of a result, which depends on the request and on the code."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from twolink.io import fingerprints
from twolink.service.work import requests


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
