"""The object store: a folder, and S3 by a stand-in."""

import asyncio
import errno
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.parts.service.fake_s3 import FakeS3, fake_s3
from twolink.errors import TwolinkError
from twolink.parts.service.problems import Refusal, problem_of
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.data_folder import NAMED_ROBOTS, PARTS, Copies
from twolink.parts.service.store.store import Store

pytest.importorskip("obstore")
JOB, ROBOT = "sweep-00000000000000000001", "u-0123456789abcdef0123"


@pytest.fixture
def s3(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[FakeS3]]:
    with fake_s3() as (server, environment):
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        yield server


@pytest.fixture(params=["file", "s3"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "file":
        return f"file://{tmp_path}/objects"
    request.getfixturevalue("s3")
    return "s3://bucket/some/folder"


def copies(folder: Path, url: str) -> Copies:
    for part in PARTS:
        (folder / part).mkdir(parents=True)
    return Copies(folder, url)


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_what_one_keeps_another_brings(tmp_path: Path, url: str) -> None:
    a, b = (copies(tmp_path / name, url) for name in "ab")
    here, there = (tmp_path / name / "results" / JOB for name in "ab")
    (here / "sweep.zarr/q/c").mkdir(parents=True)
    for k in range(4):
        (here / f"sweep.zarr/q/c/{k}").write_bytes(bytes([k]) * 3_000_000)
    (here / "empty").write_bytes(b"")
    (here / "draft-result.csv").write_bytes(b"half")
    os.symlink("/etc/hostname", here / "link")
    assert not b.bring(JOB, 1)
    a.keep(JOB)
    assert b.bring(JOB, 1)
    expected = {name: content for name, content in files(here).items() if name not in ("draft-result.csv", "link")}
    assert files(there) == expected
    (here / "sweep.zarr/q/c/4").write_bytes(b"more")
    a.keep(JOB)
    assert b.bring(JOB, 1)
    assert "sweep.zarr/q/c/4" not in files(there)  # the state of the job is the same
    assert b.bring(JOB, 2)
    assert files(there)["sweep.zarr/q/c/4"] == b"more"
    b.drop("results", JOB)
    assert not there.exists()
    assert not a.bring(JOB, 3)


def test_a_robot_goes_from_where_it_is_staged(tmp_path: Path, url: str) -> None:
    a, b = (copies(tmp_path / name, url) for name in "ab")
    staged = tmp_path / "a" / "staging" / ROBOT
    staged.mkdir()
    (staged / "robot.urdf").write_text("<robot/>")
    a.keep(ROBOT)
    named = b.named_robots(b'{"scene": {"robot": "%s"}, "other": "u-99999999999999999999"}' % ROBOT.encode())
    assert named == {ROBOT, "u-99999999999999999999"}
    b.bring_robots(named)
    assert files(tmp_path / "b" / "robots") == {f"{ROBOT}/robot.urdf": b"<robot/>"}


def test_a_store_that_fails_is_the_failure_of_storage(tmp_path: Path, s3: type[FakeS3]) -> None:
    store = copies(tmp_path, "s3://bucket")
    folder = tmp_path / "results" / JOB
    folder.mkdir()
    (folder / "result.npz").write_bytes(b"x")
    s3.do_PUT = lambda self: (self._asked(), self._answer(403, b"<Error><Code>AccessDenied</Code></Error>"))[0]
    with pytest.raises(OSError, match="the object store") as failed:
        store.keep(JOB)
    assert failed.value.errno is not None
    assert "\n" not in str(failed.value)


def test_robots_that_nobody_uploaded_are_not_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path / "data", Quotas(), objects=f"file://{tmp_path}/objects")
    asked: list[str] = []
    monkeypatch.setattr(store.copies, "bring_robots", asked.extend)
    store._execute("INSERT INTO robots (id, created, used, bytes, description, owner) VALUES (?, 0, 0, 0, '{}', '')",
                   (ROBOT,))  # fmt: skip
    ids = [ROBOT, *(f"u-{k:020x}" for k in range(NAMED_ROBOTS))]
    asyncio.run(store.bring_robots(" ".join(ids[:-1]).encode()))
    assert asked == [ROBOT]
    with pytest.raises(Refusal, match=f"names {NAMED_ROBOTS + 1} uploaded robots"):
        asyncio.run(store.bring_robots(" ".join(ids).encode()))
    store.close()


def test_clients_do_not_see_where_the_store_is() -> None:
    problem = problem_of(OSError(errno.EIO, "the object store: s3://secret-bucket does not answer"))
    assert problem.status == 503
    assert "secret" not in problem.detail


@pytest.mark.parametrize("url", ["nonsense", "ftp://host/folder", "http://[", "file://relative"])
def test_what_is_no_store_is_refused(tmp_path: Path, url: str) -> None:
    with pytest.raises(TwolinkError, match="--store"):
        Copies(tmp_path, url)
