"""Worker processes may crash, hang, take all memory and print; the service gets a problem, and goes on."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from tests.parts.service.working import noted, working
from twolink.errors import RobotError, TwolinkError
from twolink.parts.service.problems import Refusal, problem_of
from twolink.parts.service.work import worker_process

pytestmark = pytest.mark.anyio


@pytest.mark.some(2)
@pytest.mark.parametrize(("task", "kind", "part"), [
    ("crash", "worker-died", "signal 11"), ("leave", "worker-died", "died"), ("hoard", "too-large", "memory"),
    ("hoard_in_llvm", "too-large", "memory"), ("refuse", "robot-error", "it broke"),
    ("fail", "internal-error", "its log"),
])  # fmt: skip
async def test_a_failure_is_reported_and_the_next_task_is_done(task: str, kind: str, part: str) -> None:
    async with working() as workers:
        with pytest.raises(TwolinkError) as caught:
            await workers.run(task, 60)
        assert problem_of(caught.value).type == f"urn:twolink:{kind}"
        assert part in str(caught.value)
        assert "secret" not in str(caught.value)
        assert await workers.run("chatter", 60) == "heard"


def own_tasks(folder: Path, patch: pytest.MonkeyPatch, begin: str) -> str:
    """A module of tasks that does something as it begins."""
    (folder / "own_tasks.py").write_text(f"import time\n{begin}\nTASKS = {{'answer': lambda: 'here'}}\n")
    patch.setenv("PYTHONPATH", os.pathsep.join([str(folder), *sys.path]))
    return "own_tasks"


@pytest.mark.slow
async def test_a_task_has_its_time_after_the_process_has_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = own_tasks(tmp_path, monkeypatch, "time.sleep(1.5)")
    async with working(tasks=tasks) as workers:
        assert await workers.run("answer", 1.0) == "here"


async def test_that_a_process_cannot_begin_is_no_fault_of_a_task(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with working(tasks=own_tasks(tmp_path, monkeypatch, "raise OSError('no room')")) as workers:
        with pytest.raises(Refusal, match="no worker process was ready") as caught:
            await workers.run("answer", 60)
    assert caught.value.status == 503


@pytest.mark.some(1)
@pytest.mark.parametrize(("task", "seconds", "idle"), [("compute", 0.5, 0.02), ("sleep", 0.05, 0.1), ("sleep", 0.5, 1)])
async def test_a_task_that_takes_too_much_processor_time_is_killed_and_so_is_what_hangs(
    task: str, seconds: float, idle: float
) -> None:
    async with working(idle=idle) as workers:
        seen: list[int] = []
        await workers.run("chatter", 60)
        with pytest.raises(Refusal, match=rf"{seconds} s"):
            await workers.run(task, seconds, on_question=noted(seen.append), nap=1000)
        with pytest.raises(ProcessLookupError):
            os.kill(seen[0], 0)
        assert await workers.run("chatter", 60) == "heard"


async def test_time_in_which_a_process_gets_no_processor_hardly_counts() -> None:
    async with working() as workers:
        await workers.run("chatter", 60)
        assert await workers.run("sleep", 0.2, nap=1.0) > 0


async def test_a_task_goes_on_when_its_report_is_answered() -> None:
    async with working() as workers:
        go, seen = asyncio.Event(), list[int]()

        async def answer(value: int) -> dict[str, Any]:
            seen.append(value)
            await go.wait()
            return {}

        task = asyncio.create_task(workers.run("sleep", 60, on_question=answer, nap=0.0))
        done, _ = await asyncio.wait([task], timeout=2.0)
        assert not done
        go.set()
        assert await task == seen[0]


@pytest.mark.slow
async def test_what_others_have_compiled_is_left_to_them() -> None:
    async with working(count=4, spare=True) as workers:
        first = await workers.run("sleep", 60, nap=0.0)
        await workers.run("chatter", 60)
        await workers.run("chatter", 60)
        assert await workers.run("sleep", 60, nap=0.0) == first


async def test_a_worker_killed_in_its_task_is_replaced() -> None:
    async with working() as workers:

        def kill(process: int) -> None:
            os.kill(process, signal.SIGKILL)

        with pytest.raises(Refusal, match="signal 9"):
            await workers.run("sleep", 60, on_question=noted(kill), nap=1000)
        assert await workers.run("chatter", 60) == "heard"


async def test_cancelling_ends_the_process() -> None:
    async with working() as workers:
        seen: asyncio.Queue[int] = asyncio.Queue()
        task = asyncio.create_task(workers.run("sleep", 60, on_question=noted(seen.put_nowait), nap=1000))
        process = await seen.get()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


@pytest.mark.slow
async def test_the_event_loop_goes_on_while_a_process_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    loop_goes_on, start = threading.Event(), subprocess.Popen

    def slow_start(*arguments: Any, **options: Any) -> Any:
        assert loop_goes_on.wait(10)
        return start(*arguments, **options)

    async with working() as workers:
        monkeypatch.setattr(subprocess, "Popen", slow_start)
        asyncio.get_running_loop().call_later(0.05, loop_goes_on.set)
        assert await workers.run("chatter", 60) == "heard"


@pytest.mark.slow
async def test_cancelling_a_start_leaves_no_process_and_no_open_file(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, cancelled, start = threading.Event(), threading.Event(), subprocess.Popen
    started: list[int] = []

    def slow_start(*arguments: Any, **options: Any) -> Any:
        begun.set()
        assert cancelled.wait(10)
        process = start(*arguments, **options)
        started.append(process.pid)
        return process

    async with working() as workers:
        await workers.run("chatter", 60)  # whatever stays open for good is open
        await workers.close()
        await asyncio.sleep(0)  # its socket is closed
        before = os.listdir("/proc/self/fd")
        monkeypatch.setattr(subprocess, "Popen", slow_start)
        task = asyncio.create_task(workers.run("chatter", 60))
        await asyncio.to_thread(begun.wait, 10)
        task.cancel()
        await asyncio.sleep(0)
        cancelled.set()
        with pytest.raises(asyncio.CancelledError):
            await task
        with pytest.raises(ProcessLookupError):
            os.kill(started[0], 0)
        assert len(os.listdir("/proc/self/fd")) == len(before)


async def test_a_process_yields_from_its_start() -> None:
    process = await worker_process.start(("sleep", "60"), os.environ, (), 10)  # it does nothing about it itself
    assert os.getpriority(os.PRIO_PROCESS, process.pid) == min(19, os.nice(0) + 10)
    assert process.returncode is None
    process.kill()
    await process.wait()
    assert process.returncode == -signal.SIGKILL


async def test_only_so_many_tasks_wait() -> None:
    async with working(waiting=4) as workers:
        begun: asyncio.Queue[int] = asyncio.Queue()
        first = asyncio.create_task(workers.run("sleep", 60, on_question=noted(begun.put_nowait), nap=0.5))
        await begun.get()
        others = [asyncio.create_task(workers.run("chatter", 60)) for _ in range(4)]
        ends = await asyncio.gather(first, *others, return_exceptions=True)
        refused = [end for end in ends if isinstance(end, Refusal)]
        assert [(end.status, end.code) for end in refused] == [(503, "busy")] * 2  # one client may hold half of 4
        assert all(end.retry_after for end in refused)
        assert ends.count("heard") == 2


async def test_large_contents_go_through_memory_that_both_have_open() -> None:
    async with working() as workers:
        for content in (bytes(range(256)) * 100_000, b"small", b"", b"x" * 10_000_000):
            assert await workers.exchange("reverse", 60, content) == (len(content), content[::-1])
        with pytest.raises(RobotError):
            await workers.exchange("refuse", 60, b"something")
        assert await workers.exchange("reverse", 60, b"after it") == (8, b"ti retfa")


async def test_workers_are_used_again_and_answers_may_be_large() -> None:
    async with working(count=2) as workers:
        first, second = [await workers.run("sleep", 60, nap=0) for _ in range(2)]
        assert first == second
        assert len(await workers.run("large", 60)) == 20_000_000
        both = await asyncio.gather(*(workers.run("sleep", 60, nap=0.3) for _ in range(2)))
        assert len(set(both)) == 2


@pytest.mark.slow
async def test_a_worker_is_replaced_by_its_memory_and_not_by_the_number_of_its_tasks() -> None:
    async with working(megabytes=500) as workers:
        small = [await workers.run("grow", 60, megabytes=0) for _ in range(150)]
        assert len(set(small)) == 1
        large = [await workers.run("grow", 60, megabytes=80) for _ in range(8)]
        assert large[0] == small[0]  # kept while there is room
        assert 2 <= len(set(large)) <= 4


@pytest.mark.slow
async def test_a_task_that_takes_all_memory_is_ended_and_says_so() -> None:
    async with working(count=2, megabytes=300) as workers:
        other = asyncio.create_task(workers.run("sleep", 60, nap=1.0))
        with pytest.raises(Refusal, match="all workers may have 300 MB") as refused:
            await workers.run("grow", 60, megabytes=400, nap=1000)
        assert (refused.value.status, refused.value.code) == (422, "too-large")
        await other  # the smaller one goes on


@pytest.mark.slow
async def test_where_several_take_the_memory_one_is_to_ask_again() -> None:
    async with working(count=3, megabytes=400) as workers:
        await asyncio.gather(*(workers.run("sleep", 60, nap=0.2) for _ in range(3)))  # all three have begun
        tasks = (workers.run("grow", 60, megabytes=120, nap=2.0) for _ in range(3))
        ends = await asyncio.gather(*tasks, return_exceptions=True)
        refused = [end for end in ends if isinstance(end, Refusal)]
        assert 1 <= len(refused) <= 2
        assert all((end.status, end.code) == (503, "busy") and end.retry_after for end in refused)
        assert sum(isinstance(end, int) for end in ends) == 3 - len(refused)


@pytest.mark.skipif(sys.platform != "linux", reason="/proc tells what the system still keeps")
async def test_ended_workers_are_put_away_by_one_of_several_that_look() -> None:
    """Another that looked, while one waited for their end, found them gone: ValueError, a 500 under attack."""
    async with working(2) as workers:
        await asyncio.gather(*(workers.run("grow", 60, megabytes=0, nap=0.5) for _ in range(2)))
        assert len(workers._workers) == 2
        for each in list(workers._workers):
            each.ended_at = 1
            each.kill()
        assert await asyncio.gather(*(workers.run("chatter", 60) for _ in range(2))) == ["heard"] * 2


async def test_an_idle_worker_that_is_ended_for_its_memory_leaves_nothing() -> None:
    """It stayed a zombie until the next task that looked at it."""
    async with working(megabytes=200) as workers:
        large = await workers.run("grow", 60, megabytes=150)
        async with asyncio.timeout(20):
            while Path(f"/proc/{large}").exists():
                await asyncio.sleep(0.05)
        assert await workers.run("grow", 60, megabytes=0) != large
