"""Do the tests pass with the rounding of other processors? NumPy and OpenBLAS choose their code by the processor; here
they are told to take that of older ones, where sums have another order and no fused multiplications.

    python -m scripts.studies.processors [-- PYTEST_ARGUMENTS]

Pinocchio is compiled for one processor, which does not change.
"""

import os
import platform
import subprocess
import sys

import numpy as np

from scripts.runner import TOP, options


def found() -> list[str]:
    """The extensions of this processor that NumPy has code of its own for."""
    return [*np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])]


def variants() -> dict[str, dict[str, str]]:
    """Environment variables by the processor that they stand for: the oldest, and the next older than this one."""
    extensions = found()
    wide = [name for name in extensions if "512" in name or name == "X86_V4"]
    oldest = {"NPY_DISABLE_CPU_FEATURES": " ".join(extensions)}
    if platform.machine() not in ("x86_64", "AMD64"):
        return {"no extensions of NumPy": oldest}
    chosen = {"Nehalem (2008)": oldest | {"OPENBLAS_CORETYPE": "Nehalem"}}
    if wide:
        older = {"NPY_DISABLE_CPU_FEATURES": " ".join(wide), "OPENBLAS_CORETYPE": "Haswell"}
        return chosen | {"Haswell (2013)": older}
    return chosen | {"Sandy Bridge (2011), by OpenBLAS alone": {"OPENBLAS_CORETYPE": "Sandybridge"}}


def main() -> int:
    arguments, failed = options(__doc__, rest=()).rest or ["-n", "2"], 0
    for name, variables in variants().items():
        print(f"{name}: {', '.join(f'{key}={value!r}' for key, value in variables.items())}", flush=True)
        done = subprocess.run([sys.executable, "-m", "pytest", *arguments], cwd=TOP, env={**os.environ, **variables})
        failed += done.returncode != 0
        print(f"{name}: {'passed' if done.returncode == 0 else 'FAILED'}", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
