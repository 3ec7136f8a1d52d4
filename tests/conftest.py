"""Tests send Ctrl-C. A background job of a shell starts with it ignored, and its children inherit that."""

import signal

signal.signal(signal.SIGINT, signal.default_int_handler)
