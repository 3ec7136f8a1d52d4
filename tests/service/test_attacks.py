"""The service answers /health at once and keeps to its memory while all that may be asked of it is asked at once."""

from __future__ import annotations

import subprocess
import sys


def test_connections_leave_files_for_the_service() -> None:
    code = """
import resource
resource.setrlimit(resource.RLIMIT_NOFILE, (300, 500))
from twolink.service.server import uvicorn_options
from twolink.service.settings import Settings
print(uvicorn_options(Settings(data="."))["http"].args[0].connections.limit)
"""
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(answer.stdout) == 300
