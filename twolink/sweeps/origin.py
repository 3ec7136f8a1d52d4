"""Where results come from: versions, machine and time."""

import functools
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from twolink._version import __version__

LIBRARIES = ("pin", "heyoka", "numpy", "scipy", "zarr", "xarray")


def origin() -> dict[str, Any]:
    """Versions, machine (kind of processor and system, no names) and the time (UTC)."""
    return {"twolink": __version__, "versions": _versions(), "machine": f"{platform.machine()}, {_processor()}",
            "system": f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
            "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())}  # fmt: skip


@functools.cache
def _versions() -> dict[str, str]:
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = ""
    return found


@functools.cache
def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return next((line.partition(":")[2].strip() for line in file if line.startswith("model name")), "")
    except OSError:
        return platform.processor()
