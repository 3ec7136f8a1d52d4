"""Tests send Ctrl-C. A background job of a shell starts with it ignored, and its children inherit that."""

import signal

from tests.show.browser import browser, chromium

__all__ = ["browser", "chromium"]  # fixtures

signal.signal(signal.SIGINT, signal.default_int_handler)
