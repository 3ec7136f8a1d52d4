"""Do the tests pass on the oldest and the newest Python that are found here? Each gets an environment of its own.

    python -m scripts.studies.pythons [-- PYTEST_ARGUMENTS]

The Python that runs this is left out: scripts/test is its run.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from scripts.runner import TOP, options

OLDEST, NEWEST = 11, 20
HERE = f"3.{sys.version_info.minor}"


def found() -> dict[str, str]:
    """Interpreters that start, by version, the oldest first."""
    places = {f"3.{minor}": shutil.which(f"python3.{minor}") for minor in range(OLDEST, NEWEST)}
    return {version: place for version, place in places.items()
              if place and subprocess.run([place, "-c", ""], capture_output=True).returncode == 0}  # fmt: skip


def tests_pass(version: str, place: str, arguments: list[str]) -> bool:
    """Install twolink with its test extras in a new environment, and run the tests there."""
    with tempfile.TemporaryDirectory(prefix="twolink-python-") as folder:
        python = str(Path(folder) / "bin/python")
        install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        steps = [[place, "-m", "venv", folder],
                 [*install, "-c", str(TOP / "scripts/constraints.txt"), "-e", f"{TOP}[test]"],
                 [python, "-m", "pytest", *arguments]]  # fmt: skip
        passed = all(subprocess.run(step, cwd=TOP).returncode == 0 for step in steps)
    print(f"Python {version}: {'passed' if passed else 'FAILED'}", flush=True)
    return passed


def main() -> int:
    arguments = options(__doc__, rest=()).rest or ["-n", "2"]
    pythons = found()
    others = {version: pythons[version] for version in [*pythons][:1] + [*pythons][-1:] if version != HERE}
    print(f"found: {', '.join(pythons) or 'none'}; tests run on {', '.join(others) or 'none other than ' + HERE}")
    return int(not all(tests_pass(version, place, arguments) for version, place in others.items()))


if __name__ == "__main__":
    sys.exit(main())
