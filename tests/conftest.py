"""For all tests: Ctrl-C, their order, and the browser."""

import signal

import pytest

from tests.show.browser import browser, chromium

__all__ = ["browser", "chromium"]  # fixtures
_LONG = ("tests/docs/", "tests/test_readme.py")  # single tests of half a minute

# Tests send Ctrl-C. A background job of a shell starts with it ignored, and its children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest tests: at the end no process should have one before it while the others have none."""
    items.sort(key=lambda item: not item.nodeid.startswith(_LONG))
