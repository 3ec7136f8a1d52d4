"""Do the core's tests pass without the parts?

    python -m scripts.studies.core [PYTEST_ARGUMENTS ...]

Runs them on a copy of the package without `parts` and the modules that have their public names. Tests of parts, and of
what is made from all of the package (its faces, its docs), are left out.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from scripts.runner import options, tests_of_a_copy

WHOLE = ("tests/parts", "tests/docs", "tests/test_architecture.py", "tests/test_face.py", "tests/test_nightly.py",
         "tests/test_public.py", "tests/test_readme.py", "tests/test_scripts.py")  # fmt: skip


def main() -> int:
    given = options(__doc__, rest=("-n", "2"))
    with tempfile.TemporaryDirectory() as folder:
        left_out = [f"--ignore={one}" for one in WHOLE]
        tests = tests_of_a_copy(Path(folder), [*left_out, "-m", "not slow and not parts", *given.rest])
        shutil.rmtree(Path(folder, "twolink", "parts"))
        for door in ("gym", "identification", "sweeps"):
            Path(folder, "twolink", f"{door}.py").unlink()
        return subprocess.run(**tests, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
