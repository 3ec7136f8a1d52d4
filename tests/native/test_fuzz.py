"""Whatever the native library is called with, it answers with a code and does not crash."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ENTRIES = ("tl_attempts", "tl_columns", "tl_method_new", "tl_program_new")


@pytest.mark.some(1)
@pytest.mark.parametrize(("seed", "count"), [(0, 150), *((seed, 400) for seed in range(1, 6))])
def test_no_call_crashes(seed: int, count: int) -> None:
    done = subprocess.run([sys.executable, "-m", "tests.native.fuzzing", str(seed), str(count)], capture_output=True,
                          text=True, cwd=Path(__file__).parents[2], env=dict(os.environ), check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    for entry in ENTRIES:
        for outcome in ("fine", "refused"):
            assert f"{entry} {outcome}" in done.stdout
