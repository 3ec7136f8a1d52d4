"""Does the native library ever read or write where it must not? Its tests with the sanitizers of the C compiler.

    python -m scripts.studies.sanitizers [TESTS ...] [--cc gcc]

Builds the library with the address and the undefined-behaviour sanitizers, for the base level of processors, and runs
the tests (of programs, steps, dynamics and simulations unless others are named) with it. Ends 0 if no test fails and
no sanitizer reports.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from hatch_build import FLAGS, digest, sources
from scripts.runner import options

TESTS = ("tests/native", "tests/integrate", "tests/dynamics", "tests/simulation")
CHECKS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-O1", "-g", "-Wno-unknown-pragmas"]


def build(compiler: str, path: Path) -> None:
    """Build the library with sanitizers."""
    defined = ["-DLEVEL=base", f"-DSOURCES={digest()}"]
    own = [flag for flag in FLAGS if flag not in ("-O3", "-g0", "-ffp-contract=on")]
    command = [compiler, *own, *CHECKS, *defined, "-shared", *map(str, sources("c")), "-lm", "-o", str(path)]
    subprocess.run(command, check=True)


def main() -> int:
    given = options(__doc__, rest=TESTS, cc="gcc")
    if shutil.which(given.cc) is None:
        print(f"there is no {given.cc}: name another compiler by --cc", file=sys.stderr)
        return 2
    path = Path("out", "libtwolink-sanitized.so").resolve()
    path.parent.mkdir(exist_ok=True)
    build(given.cc, path)
    # The exceptions of C++ libraries are caught only where their runtime is loaded before the sanitizer's.
    runtimes = [subprocess.run([given.cc, f"-print-file-name={name}"], capture_output=True, text=True, check=True)
                for name in ("libasan.so", "libstdc++.so.6")]  # fmt: skip
    preloaded = " ".join(one.stdout.strip() for one in runtimes)
    environment = {**os.environ, "TWOLINK_NATIVE": str(path), "LD_PRELOAD": preloaded,
                   "ASAN_OPTIONS": "detect_leaks=0:verify_asan_link_order=0"}  # fmt: skip
    return subprocess.run([sys.executable, "-m", "pytest", "-x", *given.rest], env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
