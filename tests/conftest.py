"""For all tests: a cache of their own, Ctrl-C, their order, and the browser."""

import collections
import gc
import os
import shutil
import signal
import tempfile

import pytest

from tests.show.browser import browser, chromium

__all__ = ["browser", "chromium"]  # fixtures
_LONG = ("tests/docs/", "tests/test_readme.py")  # single tests of half a minute
_own_cache = pytest.StashKey[str]()

# Tests send Ctrl-C. A background job of a shell starts with it ignored, and its children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    """Begin with an empty cache: what earlier runs compiled or measured must not decide what tests see.

    The workers of pytest-xdist inherit the folder, so that each kernel is compiled once. Who sets TWOLINK_CACHE keeps
    a warm cache between runs.
    Linear algebra has one thread in workers and children: beside others its threads wait, 50 ms for an inverse of 0.2.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else each of the processes compiles every module
    if "TWOLINK_CACHE" not in os.environ:
        config.stash[_own_cache] = os.environ["TWOLINK_CACHE"] = tempfile.mkdtemp(prefix="twolink-tests-")


def pytest_collection() -> None:
    """Collect no garbage while tests are imported: there is none, and each look at all objects takes longer."""
    gc.disable()


def pytest_collection_finish() -> None:
    """What was imported stays: collections of garbage leave it out."""
    gc.freeze()
    gc.enable()


def pytest_unconfigure(config: pytest.Config) -> None:
    """Delete the cache of this run."""
    if _own_cache in config.stash:
        shutil.rmtree(config.stash[_own_cache], ignore_errors=True)
        del os.environ["TWOLINK_CACHE"]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as slow what `some(n)` leaves to the nightly run: all but the first n parameters of a test.

    Begin with the longest tests: at the end no process should have one before it while the others have none.
    """
    seen = collections.Counter[str]()
    for item in items:
        name = item.nodeid.partition("[")[0]
        seen[name] += 1
        marked = item.get_closest_marker("some")
        if marked is not None and seen[name] > marked.args[0]:
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: not item.nodeid.startswith(_LONG))
