"""Whatever the native library is called with, it answers with a code and does not crash."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CALLS = {"fuzzing": ("tl_attempts", "tl_columns", "tl_method_new", "tl_program_new", "tl_ticks"),
         "fuzzing_contacts": ("tl_contact_new", "tl_contact_run")}  # fmt: skip


@pytest.mark.some(2)
@pytest.mark.parametrize("module", CALLS)
@pytest.mark.parametrize(("seed", "count"), [(0, 150), *((seed, 400) for seed in range(1, 6))])
def test_no_call_crashes(module: str, seed: int, count: int) -> None:
    done = subprocess.run([sys.executable, "-m", f"tests.native.{module}", str(seed), str(count)], capture_output=True,
                          text=True, cwd=Path(__file__).parents[2], env=dict(os.environ), check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    for entry in CALLS[module]:
        for outcome in ("fine", "refused"):
            assert f"{entry} {outcome}" in done.stdout
