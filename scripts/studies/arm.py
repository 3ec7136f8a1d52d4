"""Does the native library compute the same bits on arm64 as here? Programs of robots under qemu, in every width.

    python -m scripts.studies.arm [ROBOT ...] [--columns 37]

Builds the library's sources with scripts/studies/arm.c by zig (pip install ziglang) and runs them under
qemu-aarch64-static (Debian: qemu-user-static). Forward dynamics, its derivatives and the energy of random states:
sums, products, quotients, roots, sines. exp, tanh, pow and atan2 are those of each platform's C library.
Ends 0 if all bits are those of this machine's library.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import twolink as tl
from hatch_build import FLAGS, digest, sources
from scripts.runner import Table, options
from twolink.algorithms.functions import function
from twolink.dynamics import kernels
from twolink.native.machine import Program

TARGET, QEMU = "aarch64-linux-musl", "qemu-aarch64-static"
ROBOTS = ("arm", "ur5", "panda", "go1")
QUERIES = ("forward_dynamics", "forward_dynamics_derivatives", "energy")


def build(path: Path) -> None:
    """The driver with the library's sources, for arm64."""
    driver = str(Path(__file__).with_name("arm.c"))
    subprocess.run([sys.executable, "-m", "ziglang", "cc", "-target", TARGET, "-mcpu=generic", "-static", *FLAGS,
                    "-DLEVEL=base", f"-DSOURCES={digest()}", driver, *map(str, sources("c")), "-lm", "-o", str(path)],
                   check=True)  # fmt: skip


def under_qemu(driver: Path, program: Program, x: np.ndarray) -> np.ndarray:
    """The outputs (widths, columns, outputs) of x (columns, inputs)."""
    one = program.arrays
    head = np.array([one.inputs, program.outputs, one.registers, len(one.code) // 4, len(one.scalars),
                     len(one.constants), len(x)], dtype=np.int32)  # fmt: skip
    parts = (head, one.code, one.scalars, one.constant_at, one.constants, one.output_at, x)
    content = b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
    done = subprocess.run([QEMU, str(driver)], input=content, capture_output=True, check=True)
    return np.frombuffer(done.stdout).reshape(4, len(x), program.outputs)


def main() -> int:
    given = options(__doc__, rest=ROBOTS, columns=37)
    if shutil.which(QEMU) is None:
        print(f"there is no {QEMU}: apt-get install qemu-user-static", file=sys.stderr)
        return 2
    table, different = Table("robot <10 | query <30 | instructions >12 | columns >8 | different bits >14"), 0
    with tempfile.TemporaryDirectory() as folder:
        driver = Path(folder, "driver")
        build(driver)
        for name in given.rest:
            robot = tl.load_robot(name)
            q, v = robot.random_state(given.columns, seed=1)
            tau = np.random.default_rng(1).uniform(-5.0, 5.0, v.shape)
            for query in QUERIES:
                kernel = kernels.build(robot.model, function(robot.model, query))
                x = np.concatenate([q, v, tau], axis=1)[:, : sum(kernel.sizes)]
                here, there = kernel.program(x.T).T, under_qemu(driver, kernel.program, x)
                off = int((here.view(np.int64) != np.ascontiguousarray(there).view(np.int64)).sum())
                different += off
                table.add(name, query, kernel.arrays.instructions, given.columns, off)
    return 0 if different == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
