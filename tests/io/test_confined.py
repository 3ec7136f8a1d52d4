"""Files are opened only inside their folder, only regular ones, and only up to a size."""

import os
from pathlib import Path

import pytest

from twolink.io.files import read_confined


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
