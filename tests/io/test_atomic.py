"""Files are written whole or not at all."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

import pytest

from twolink.errors import TwolinkError
from twolink.io.files import write_atomic


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
    with pytest.raises(TwolinkError, match="cannot be written") as caught:
        write_atomic(tmp_path / "file" / "x", lambda file: file.write(b""))
    assert caught.value.code == "not-writable"
    assert caught.value.where == str(tmp_path / "file" / "x")
