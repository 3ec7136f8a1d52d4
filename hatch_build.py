"""Builds the native library (twolink/native/**/*.c) by zig's C compiler, a build requirement: users need no compiler.

TWOLINK_TARGET is zig's name of another platform, such as aarch64-macos.11.0: a wheel for it is built. With
TWOLINK_NO_NATIVE=1 a wheel has no library, and NumPy computes.
"""

import hashlib
import os
import platform
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # the studies use `build` without hatchling
    BuildHookInterface = object

NATIVE = Path(__file__).parent / "twolink" / "native"
LEVELLED = ("columns", "taylor", "contact/blocks")  # compiled for each level of a processor
FLAGS = [
    "-std=gnu99",
    "-O3",
    "-fPIC",
    "-fvisibility=hidden",
    "-ffp-contract=on",
    "-fno-math-errno",
    "-Wno-psabi",
    "-g0",
]
# zig's names of the platforms that wheels are built for, the name of the library there, and the wheel's tag.
PLATFORMS = {
    "x86_64-linux-gnu.2.17": ("libtwolink.so", "manylinux_2_17_x86_64"),
    "aarch64-linux-gnu.2.17": ("libtwolink.so", "manylinux_2_17_aarch64"),
    "x86_64-linux-musl": ("libtwolink.so", "musllinux_1_1_x86_64"),
    "aarch64-linux-musl": ("libtwolink.so", "musllinux_1_1_aarch64"),
    "x86_64-macos.11.0": ("libtwolink.dylib", "macosx_11_0_x86_64"),
    "aarch64-macos.11.0": ("libtwolink.dylib", "macosx_11_0_arm64"),
    "x86_64-windows-gnu": ("twolink.dll", "win_amd64"),
    "aarch64-windows-gnu": ("twolink.dll", "win_arm64"),
}


class NativeLibrary(BuildHookInterface):
    """Compiles the library beside its sources and puts it into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Before a wheel or an editable installation is built."""
        if os.environ.get("TWOLINK_NO_NATIVE"):
            return
        target = os.environ.get("TWOLINK_TARGET") or host()
        name, tag = PLATFORMS[target]
        build(target, NATIVE / name)
        if version == "editable":
            tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["force_include"][str(NATIVE / name)] = f"twolink/native/{name}"
        build_data["tag"] = f"py3-none-{tag}"


def host() -> str:
    """zig's name of this machine's platform."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    if sys.platform == "linux":
        musl = not platform.libc_ver()[0]
        return f"{machine}-linux-" + ("musl" if musl else "gnu.2.17")
    return f"{machine}-macos.11.0" if sys.platform == "darwin" else f"{machine}-windows-gnu"


def build(target: str, path: Path) -> None:
    """Compile the library for a platform, with code for three levels of x86-64 processors."""
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", target]
    x86 = target.startswith("x86_64")
    cpu = "-mcpu=x86_64" if x86 else "-mcpu=apple_m1" if "macos" in target else "-mcpu=generic"
    levels = {"base": cpu}
    if x86:
        levels |= {"v3": "-mcpu=x86_64_v3", "v4": "-mcpu=x86_64_v4"}
    with tempfile.TemporaryDirectory() as folder:
        jobs = [(f"{folder}/{Path(name).name}-{level}.o", NATIVE / f"{name}.c", [f"-DLEVEL={level}", option])
                for level, option in levels.items() for name in LEVELLED]  # fmt: skip
        own = [f"-DSOURCES={digest()}", cpu, *(["-DX86_LEVELS"] if x86 else [])]
        levelled = [NATIVE / f"{name}.c" for name in LEVELLED]
        jobs += [(f"{folder}/{source.stem}.o", source, own) for source in sources("c") if source not in levelled]
        environment = {"ZIG_GLOBAL_CACHE_DIR": folder, "ZIG_LOCAL_CACHE_DIR": folder, **os.environ}
        running = [subprocess.Popen([*zig, *FLAGS, *options, "-c", str(source), "-o", made], env=environment)
                   for made, source, options in jobs]  # fmt: skip
        for (_, source, _), process in zip(jobs, running, strict=True):
            if process.wait():
                raise RuntimeError(f"zig cc failed to compile {source} for {target}")
        objects = [made for made, *_ in jobs]
        libm = [] if "windows" in target else ["-lm"]
        linked = path.with_name(f".{path.name}.{os.getpid()}")
        subprocess.run([*zig, "-shared", "-s", *objects, *libm, "-o", str(linked)], check=True, env=environment)
        linked.replace(path)  # a process that has loaded the old one keeps it


def sources(kinds: str = "ch") -> list[Path]:
    """The files of C, by their names and those of their folders."""
    return sorted(NATIVE.rglob(f"*.[{kinds}]"), key=Path.as_posix)


def digest() -> str:
    """The digest of the sources, as `twolink.native.library` computes it."""
    content = hashlib.sha256()
    for file in sources():
        content.update(file.name.encode() + b"\0" + file.read_bytes().replace(b"\r\n", b"\n"))
    return content.hexdigest()[:16]
