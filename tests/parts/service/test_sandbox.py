"""A worker process that a stranger has taken over: no file of others, no network, no program, no secret."""

import asyncio
import ctypes
import errno
import os
import platform
import re
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tests.parts.service import escape_tasks
from tests.parts.service.working import working
from twolink.errors import TwolinkError
from twolink.parts.service.work import sandbox

CAN = sandbox.protection()
FILES = ("read", "listing", "write", "link", "remove", "give_away", "memory_of_the_service")
SERVICE = (
    "signal_the_service", "owner_of_signals", "limits_of_the_service", "priority_of_the_service",
    "processors_of_the_service", "disk_priority_of_the_service", "permissions", "times", "name_of_the_machine",
)  # fmt: skip
CALLS = ("tcp", "udp", "pair", "program", "execute", "forked", "c_library", "trace", *SERVICE)
PROBES = {335, 336}  # uretprobe, uprobe: not judged by filters, they end the process that was not made to call them
UNSAFE_HERE = ("execute", "trace", "remove", "name_of_the_machine")  # not for a control in this process


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """A file of the host, a server of the host, and what each escape takes."""
    file = tmp_path_factory.mktemp("host") / "secret"
    file.write_text("the host's own")
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                connection.sendall(b"an answer")
                connection.close()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield {"at": str(file), "port": server.getsockname()[1]}
        server.shutdown(socket.SHUT_RDWR)
        thread.join(10)


def arguments(task: str, place: dict[str, Any]) -> dict[str, Any]:
    return {name: place[name] for name in getattr(escape_tasks, task).__annotations__ if name in place}


@pytest.fixture(scope="module")
def results(place: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What each task gave, or its failure, in one worker."""
    own, library = tmp_path_factory.mktemp("own"), tmp_path_factory.mktemp("lib") / "site-packages"
    library.mkdir()
    (library / "installed_for_one_user.py").write_text("WORD = 'found'")

    async def work() -> dict[str, Any]:
        found: dict[str, Any] = {}
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("TWOLINK_TOKEN", "hush")
            patch.setenv("OTHER_SECRET", "hush")
            patch.setenv("PYTHONPATH", os.pathsep.join([str(library), *sys.path]))
            async with working(1, 3000, escape_tasks.__name__, threads=2, writable=[own]) as workers:
                for task in set(escape_tasks.TASKS) - {"all_calls"}:
                    try:
                        found[task] = await workers.run(task, 60, **arguments(task, place))
                    except TwolinkError as failure:
                        found[task] = failure
        return found

    return asyncio.run(work())


@pytest.mark.parametrize("task", [task for task in (*FILES, *CALLS) if task not in UNSAFE_HERE])
def test_outside_a_worker_these_would_succeed(task: str, place: dict[str, Any], tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(tmp_path))
        escape_tasks.TASKS[task](**arguments(task, place))  # does not raise


@pytest.mark.parametrize("task", FILES)
@pytest.mark.skipif(not CAN.landlock, reason="this kernel has no Landlock")
def test_a_worker_reaches_no_file_of_others(task: str, results: dict[str, Any], place: dict[str, Any]) -> None:
    assert isinstance(results[task], TwolinkError), results[task]
    assert results[task].code == "denied"
    assert Path(place["at"]).exists()


@pytest.mark.parametrize("task", CALLS)
@pytest.mark.skipif(not CAN.seccomp, reason="this kernel has no seccomp")
def test_a_worker_reaches_no_network_and_no_process(task: str, results: dict[str, Any]) -> None:
    assert isinstance(results[task], TwolinkError), results[task]
    assert results[task].code == "denied"


@pytest.mark.slow
@pytest.mark.anyio
@pytest.mark.skipif(not (CAN.landlock and CAN.seccomp), reason="not on this kernel")
async def test_a_worker_that_may_use_the_network_reaches_nothing_else(place: dict[str, Any], tmp_path: Path) -> None:
    async with working(1, 3000, "tests.parts.service.network_tasks", writable=[tmp_path]) as workers:
        assert await workers.run("tcp", 60, **arguments("tcp", place)) == "an answer"
        for task in (*FILES, "program", "execute", "forked", "c_library", "trace", *SERVICE):
            with pytest.raises(TwolinkError) as caught:
                await workers.run(task, 60, **arguments(task, place))
            assert caught.value.code == "denied", task


def test_a_worker_knows_no_secret(results: dict[str, Any]) -> None:
    assert "HOME" in results["environment"]
    assert "hush" not in str(results["environment"])


@pytest.mark.skipif(not (CAN.landlock and CAN.seccomp), reason="not on this kernel")
def test_the_kernel_says_so_too(results: dict[str, Any]) -> None:
    assert (results["status"]["NoNewPrivs"], results["status"]["Seccomp"]) == ("1", "2")
    assert results["death_signal"] == 9


def test_a_worker_computes_with_threads_and_compiled_code(results: dict[str, Any]) -> None:
    assert results["late_import"] == "found"
    assert not isinstance(results["compute"], TwolinkError), results["compute"]
    assert results["compute"]["batch"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.anyio
@pytest.mark.skipif(not CAN.seccomp, reason="this kernel has no seccomp")
async def test_of_all_system_calls_only_the_listed_ones_pass() -> None:
    column = 0 if platform.machine() == "x86_64" else 1
    pairs = *sandbox._CALLS["all"].values(), *sandbox._ARGUED.values()
    listed = {pair[column] for pair in pairs if len(pair) > column}
    async with working(1, 3000, escape_tasks.__name__) as workers:
        errors = await workers.run("all_calls", 60, some=sorted(set(range(600)) - listed - PROBES))
    found = {int(number): error for number, error in errors.items()}
    assert len(found) > 400
    passed = {number for number, error in found.items() if error != (errno.EPERM if number < 452 else errno.ENOSYS)}
    assert passed == {sandbox._CLONE3}


@pytest.mark.parametrize("refused", ["prctl", "syscall"])
def test_what_the_system_refuses_is_said_and_not_required(refused: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of /proc is no sign that filters are allowed: containers have it and refuse them."""
    libc = sandbox._libc()

    def refuse(*_: Any) -> int:
        ctypes.set_errno(errno.EINVAL)
        return -1

    parts = SimpleNamespace(**{"prctl": libc.prctl, "syscall": libc.syscall, refused: refuse})
    monkeypatch.setattr(sandbox, "_libc", lambda: parts)
    found = sandbox.protection()
    assert (found.seccomp, found.landlock > 0) == ({"prctl": False, "syscall": CAN.seccomp}[refused], False)
    assert str(found).count("NOT") == 1 + (not found.seccomp)


def test_what_is_tried_holds_for_a_thread_alone() -> None:
    sandbox.protection()
    os.kill(os.getpid(), 0)
    assert os.listdir("/")


def test_the_numbers_of_the_calls_are_those_of_the_kernel() -> None:
    """Each number stands once in a table; where the headers of Linux are installed, it is theirs."""
    calls = {**sandbox._CALLS["all"], **sandbox._CALLS["network"], **sandbox._ARGUED, "clone3": (sandbox._CLONE3,) * 2}
    for column, header in enumerate(("x86_64-linux-gnu/asm/unistd_64.h", "asm-generic/unistd.h")):
        numbers = {name: pair[column] for name, pair in calls.items() if len(pair) > column}
        assert len(set(numbers.values())) == len(numbers)
        path = Path("/usr/include", header)
        if path.exists():
            stated = dict(re.findall(r"#define __NR(?:3264)?_(\w+)\s+(\d+)", path.read_text()))
            stated["newfstatat"] = stated.get("newfstatat") or stated["fstatat"]
            assert {name: str(number) for name, number in numbers.items()} == {name: stated[name] for name in numbers}


def test_what_is_active_is_said() -> None:
    assert "NOT limited" in str(sandbox.Protection(0, False))
    assert "NOT" not in str(sandbox.Protection(7, True))
    assert msgspec.to_builtins(CAN) == {"landlock": CAN.landlock, "seccomp": CAN.seccomp}
