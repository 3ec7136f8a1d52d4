"""Do the tests pass where something else is different: the package, the compiler, the processor, the Python?

    python -m scripts.studies.suite core|sanitizers|processors|pythons [-- PYTEST_ARGUMENTS]

core        a copy of the package without `parts` and the modules that have their public names; tests of parts, and of
            what is made from all of the package (its faces, its docs), are left out
sanitizers  a library by gcc (or CC) with the address and the undefined-behaviour sanitizers, for the base level of
            processors; the tests of programs, steps, dynamics and simulations unless others are named
processors  the rounding of older ones: NumPy and OpenBLAS are told to take their code, where sums have another order
            and no fused multiplications. Pinocchio is compiled for one processor, which does not change
pythons     the oldest and the newest Python that are found here, each in an environment of its own, but for the one
            that runs this: scripts/test is its run

Ends 0 if no test fails, and no sanitizer reports.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hatch_build import FLAGS, digest, sources
from scripts.runner import OUT, TOP, options, tests_of_a_copy

WHOLE = ("tests/parts", "tests/docs", "tests/test_architecture.py", "tests/test_broken_rules.py", "tests/test_face.py",
         "tests/test_nightly.py", "tests/test_public.py", "tests/test_readme.py", "tests/test_scripts.py")  # fmt: skip
OF_NATIVE = ("tests/native", "tests/integrate", "tests/dynamics", "tests/simulation")
CHECKS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-O1", "-g", "-Wno-unknown-pragmas"]
OLDEST, NEWEST = 11, 20
HERE = f"3.{sys.version_info.minor}"


def pass_here(name: str, arguments: Sequence[str], python: str = sys.executable, **variables: str) -> bool:
    """Run the tests, by a Python and with environment variables, and print whether they pass."""
    print(f"{name}: {', '.join(f'{key}={value!r}' for key, value in variables.items())}", flush=True)
    command = [python, "-m", "pytest", *arguments]
    passed = subprocess.run(command, cwd=TOP, env={**os.environ, **variables}).returncode == 0
    print(f"{name}: {'passed' if passed else 'FAILED'}", flush=True)
    return passed


def core(arguments: Sequence[str]) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        left_out = [f"--ignore={one}" for one in WHOLE]
        tests = tests_of_a_copy(Path(folder), [*left_out, "-m", "not slow and not parts", *arguments])
        shutil.rmtree(Path(folder, "twolink", "parts"))
        for door in ("gym", "identification", "sweeps"):
            Path(folder, "twolink", f"{door}.py").unlink()
        return subprocess.run(**tests, check=False).returncode == 0


def sanitizers(arguments: Sequence[str]) -> bool:
    compiler, path = os.environ.get("CC", "gcc"), OUT / "libtwolink-sanitized.so"
    OUT.mkdir(exist_ok=True)
    own = [flag for flag in FLAGS if flag not in ("-O3", "-g0", "-ffp-contract=on")]
    command = [compiler, *own, *CHECKS, "-DLEVEL=base", f"-DSOURCES={digest()}", "-shared",
               *map(str, sources("c")), "-lm", "-o", str(path)]  # fmt: skip
    subprocess.run(command, check=True)
    # The exceptions of C++ libraries are caught only where their runtime is loaded before the sanitizer's.
    runtimes = [subprocess.run([compiler, f"-print-file-name={name}"], capture_output=True, text=True, check=True)
                for name in ("libasan.so", "libstdc++.so.6")]  # fmt: skip
    return pass_here("sanitizers", ["-x", *arguments], TWOLINK_NATIVE=str(path),
                     LD_PRELOAD=" ".join(one.stdout.strip() for one in runtimes),
                     ASAN_OPTIONS="detect_leaks=0:verify_asan_link_order=0")  # fmt: skip


def variants() -> dict[str, dict[str, str]]:
    """Environment variables by the processor that they stand for: the oldest, and the next older than this one."""
    extensions = [*np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])]
    wide = [name for name in extensions if "512" in name or name == "X86_V4"]
    oldest = {"NPY_DISABLE_CPU_FEATURES": " ".join(extensions)}
    if platform.machine() not in ("x86_64", "AMD64"):
        return {"no extensions of NumPy": oldest}
    chosen = {"Nehalem (2008)": oldest | {"OPENBLAS_CORETYPE": "Nehalem"}}
    if wide:
        older = {"NPY_DISABLE_CPU_FEATURES": " ".join(wide), "OPENBLAS_CORETYPE": "Haswell"}
        return chosen | {"Haswell (2013)": older}
    return chosen | {"Sandy Bridge (2011), by OpenBLAS alone": {"OPENBLAS_CORETYPE": "Sandybridge"}}


def processors(arguments: Sequence[str]) -> bool:
    passed = [pass_here(name, arguments, **variables) for name, variables in variants().items()]
    return all(passed)


def pythons(arguments: Sequence[str]) -> bool:
    places = {f"3.{minor}": shutil.which(f"python3.{minor}") for minor in range(OLDEST, NEWEST)}
    found = {version: place for version, place in places.items()
             if place and subprocess.run([place, "-c", ""], capture_output=True).returncode == 0}  # fmt: skip
    others = {version: found[version] for version in [*found][:1] + [*found][-1:] if version != HERE}
    print(f"found: {', '.join(found) or 'none'}; tests run on {', '.join(others) or 'none other than ' + HERE}")
    return all(in_environment(version, place, arguments) for version, place in others.items())


def in_environment(version: str, place: str, arguments: Sequence[str]) -> bool:
    """Install twolink with its test extras in a new environment, and run the tests there."""
    with tempfile.TemporaryDirectory(prefix="twolink-python-") as folder:
        python = f"{folder}/bin/python"
        steps = [[place, "-m", "venv", folder],
                 [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-c",
                  str(TOP / "scripts/constraints.txt"), "-e", f"{TOP}[test]"]]  # fmt: skip
        ready = all(subprocess.run(step, cwd=TOP).returncode == 0 for step in steps)
        return ready and pass_here(f"Python {version}", arguments, python)


SUITES = {one.__name__: one for one in (core, sanitizers, processors, pythons)}


def main() -> int:
    """The chosen suite."""
    name, *arguments = options(__doc__, rest=("core",)).rest
    if name not in SUITES:
        raise SystemExit(f"unknown: {name}; known: {', '.join(SUITES)}")
    return int(not SUITES[name](arguments or (OF_NATIVE if name == "sanitizers" else ("-n", "2"))))


if __name__ == "__main__":
    raise SystemExit(main())
