"""Files are written whole or not at all, and opened only inside their folder, only regular ones, and up to a size."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

import pytest

from tests.refusals import refusal
from twolink.errors import TwolinkError
from twolink.io.files import read_confined, write_atomic


def test_a_failed_write_leaves_the_old_file_and_no_temporary_one(tmp_path: Path) -> None:
    path = write_atomic(tmp_path / "new" / "x", lambda file: file.write(b"old"))

    def fail(file: BinaryIO) -> None:
        file.write(b"half")
        raise KeyError("half")

    with pytest.raises(KeyError):
        write_atomic(path, fail)
    assert path.read_bytes() == b"old"
    assert list(path.parent.iterdir()) == [path]


def test_permissions_follow_the_umask_unless_the_file_is_private(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        shared = write_atomic(tmp_path / "shared", lambda file: file.write(b""))
        private = write_atomic(tmp_path / "private", lambda file: file.write(b""), private=True)
        assert os.umask(0o027) == 0o027
    finally:
        os.umask(before)
    assert [stat.S_IMODE(path.stat().st_mode) for path in (shared, private)] == [0o640, 0o600]


def test_a_folder_that_cannot_be_is_an_error_with_a_code(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with refusal(TwolinkError, "cannot be written", code="not-writable", where=str(tmp_path / "file" / "x")):
        write_atomic(tmp_path / "file" / "x", lambda file: file.write(b""))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "secret").write_bytes(b"secret")
    inside = tmp_path / "inside"
    (inside / "deeper").mkdir(parents=True)
    (inside / "a").write_bytes(b"12345")
    return inside


@pytest.mark.parametrize("name", ["a", "deeper/../a", "../inside/a", "link"])
def test_what_lies_inside_is_read(folder: Path, name: str) -> None:
    (folder / "link").symlink_to("a")
    assert read_confined(folder, name, 5) == b"12345"
    assert read_confined(folder, folder / name, 5) == b"12345"
    (folder.parent / "alias").symlink_to(folder)
    assert read_confined(folder.parent / "alias", name, 5) == b"12345"


@pytest.mark.parametrize("name", [
    "../secret", "deeper/../../secret", "out", "out-folder/secret", "loop", "missing", "", ".", "deeper", "a\0",
    "n" * 5000,
])  # fmt: skip
def test_what_lies_outside_or_is_no_file_is_not(folder: Path, name: str) -> None:
    (folder / "out").symlink_to(folder.parent / "secret")
    (folder / "out-folder").symlink_to(folder.parent)
    (folder / "loop").symlink_to("loop")
    with pytest.raises(OSError):  # noqa: PT011  whatever the system calls it
        read_confined(folder, name, 100)
    with pytest.raises(OSError, match="outside"):
        read_confined(folder, folder.parent / "secret", 100)


def test_what_is_too_large_or_has_no_end_is_not(folder: Path) -> None:
    with pytest.raises(OSError, match="larger than 4 bytes"):
        read_confined(folder, "a", 4)
    os.mkfifo(folder / "pipe")
    with pytest.raises(OSError, match="not a regular file"):
        read_confined(folder, "pipe", 100)
    with pytest.raises(OSError, match="not a regular file"):
        read_confined(Path("/dev"), "zero", 100)
