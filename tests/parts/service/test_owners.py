"""What clients share: time, the disk, and what each owner may see and end."""

import asyncio
import contextlib
import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest

from tests.parts.service.serving import Served, pendulum, serving, wait_until, zipped
from twolink.errors import TwolinkError
from twolink.parts.service.http.messages import AccessControl, Rates
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas, Settings
from twolink.parts.service.store.data_folder import size_of, to_remove
from twolink.parts.service.store.store import Store
from twolink.parts.service.work import time_shares
from twolink.parts.service.work.sharing import REQUEST, RequestMemory, Shares
from twolink.parts.service.work.time_shares import TimeShares

pytestmark = pytest.mark.anyio
RUN = {"scene": "arm-swing", "duration": 0.5, "wait": 30}


# The parts


def test_a_token_may_have_a_name() -> None:
    settings = Settings("data", tokens=("plain", "ann:abc-._~+/=", "b.o@x:secret"), admins=("ann",))
    assert settings.owners == [("", "plain"), ("ann", "abc-._~+/="), ("b.o@x", "secret")]
    for tokens, admins in ((("a b:c",), ()), (("ann:",), ()), (("a:b:c",), ()), (("ann:x",), ("bob",))):
        with pytest.raises(TwolinkError):
            Settings("data", tokens=tokens, admins=admins)


def test_of_results_the_owner_with_most_loses_the_oldest() -> None:
    jobs = [(f"{owner}{k}", owner, 10) for k in range(4) for owner in "ab" if owner == "a" or k < 1]  # newest first
    sizes, free = {"a": 40, "b": 10}, {"a": math.inf, "b": math.inf}
    assert to_remove(jobs, sizes, free, 0) == []
    assert to_remove(jobs, sizes, free, 25) == ["a3", "a2", "a1"]
    assert to_remove(jobs, sizes, {"a": math.inf, "b": 5}, 0) == ["b0"]
    assert len(to_remove(jobs, sizes, free, 1000)) == 5


def test_an_owner_has_so_many_requests_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    rates = Rates(2.0)

    def taken(owner: str, count: int) -> int:
        done = 0
        with contextlib.suppress(Refusal):
            while done < count:
                rates.take(owner)
                done += 1
        return done

    assert [taken("ann", 5), taken("bob", 5), taken("", 5)] == [2, 2, 5]
    now[0] = 0.5
    assert [taken("ann", 5), taken("", 5)] == [1, 5]
    with pytest.raises(Refusal) as refused:
        rates.take("ann")
    assert (refused.value.status, refused.value.retry_after) == (429, 0.5)


def test_a_request_that_is_checked_twice_counts_once_and_is_refused_twice() -> None:
    access = AccessControl(Settings(data="x", tokens=("ann:secret",), quotas=Quotas(owner_rate=1)))
    headers = [(b"host", b"localhost"), (b"authorization", b"Bearer secret")]
    taken, refused = ({"method": "POST", "path": "/v1/robots", "headers": headers} for _ in range(2))
    access.check(taken)
    access.check(taken)
    for _ in range(2):
        with pytest.raises(Refusal, match="requests a second"):
            access.check(refused)


class Clock:
    """Jobs that take time of a clock of their own."""

    def __init__(self, shares: TimeShares, patch: pytest.MonkeyPatch) -> None:
        self.now, self.shares, self.seen, self.tick = 0.0, shares, list[str](), asyncio.Event()
        patch.setattr(time_shares, "time", SimpleNamespace(monotonic=lambda: self.now))

    async def job(self, client: str, seconds: int) -> None:
        """Compute for a second, and report."""
        REQUEST.set(RequestMemory(Shares(1), client))
        async with self.shares.turn() as turn:
            for _ in range(seconds):
                await self.tick.wait()
                self.seen.append(client)
                await self.shares.go_on(turn)

    async def pass_(self, seconds: int = 1000, until: asyncio.Future[Any] | None = None) -> None:
        """Let so many seconds pass, or the time until something is done."""
        for _ in range(seconds):
            for _ in range(10):  # all that can go on has gone on
                await asyncio.sleep(0)
            if until is not None and until.done():
                return
            self.now += 1.0
            self.shares._next()
            self.tick.set()
            self.tick = asyncio.Event()

    async def wait_of(self, client: str) -> float:
        """Seconds until a job of one second is done."""
        begun = self.now
        await self.pass_(until=asyncio.create_task(self.job(client, 1)))
        return self.now - begun


async def cancelled(*jobs: asyncio.Task[None]) -> None:
    for job in jobs:
        job.cancel()
    await asyncio.gather(*jobs, return_exceptions=True)


async def test_long_jobs_share_time_and_a_short_one_does_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:

    clock = Clock(TimeShares(2), monkeypatch)
    long = [asyncio.create_task(clock.job(client, 60)) for client in "aabc"]
    await clock.pass_(60)
    counts = [clock.seen.count(client) for client in "abc"]
    assert max(counts) - min(counts) <= time_shares.SLICE + 2 * time_shares.SHORT
    assert 120 <= sum(counts) <= 130  # two at a time, and for moments three
    assert await clock.wait_of("d") <= 2
    await clock.pass_(until=asyncio.gather(*long))
    assert [clock.seen.count(client) for client in "abcd"] == [120, 60, 60, 1]
    assert not any((clock.shares._running, clock.shares._waiting, clock.shares._used))


async def test_a_clients_next_job_waits_for_those_that_have_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else all that greedy clients have sent would begin, each with a process and its memory."""
    clock = Clock(TimeShares(2), monkeypatch)
    begun = set[asyncio.Task[None] | None]()
    go_on = clock.shares.go_on

    async def counted(turn: time_shares.Turn) -> None:
        begun.add(asyncio.current_task())
        await go_on(turn)

    monkeypatch.setattr(clock.shares, "go_on", counted)
    jobs = [asyncio.create_task(clock.job(client, 200)) for client in "abc" for _ in range(10)]
    await clock.pass_(60)
    assert len(begun) <= 4 * 3  # those that ran at first, and one beside of each client
    first = set(begun)
    await clock.pass_(120)
    assert begun == first
    assert 2 * 180 <= len(clock.seen) <= 2.2 * 180  # two at a time
    assert await clock.wait_of("d") <= 3
    await cancelled(*jobs)


async def test_jobs_that_never_report_do_not_hold_up_short_ones(monkeypatch: pytest.MonkeyPatch) -> None:

    clock = Clock(TimeShares(2), monkeypatch)

    async def silent(client: str) -> None:
        REQUEST.set(RequestMemory(Shares(1), client))
        async with clock.shares.turn():
            await asyncio.Event().wait()

    hogs = [asyncio.create_task(silent(client)) for client in "abc"]
    await clock.pass_(10)
    assert await clock.wait_of("d") <= 2
    await cancelled(*hogs)


async def test_jobs_that_are_cancelled_give_their_turns_back(monkeypatch: pytest.MonkeyPatch) -> None:

    clock = Clock(TimeShares(1), monkeypatch)
    jobs = [asyncio.create_task(clock.job(client, 30)) for client in "abc"]
    await clock.pass_(12)
    await cancelled(*jobs)
    assert not any((clock.shares._running, clock.shares._waiting, clock.shares._used))
    await clock.pass_(until=asyncio.create_task(clock.job("d", 1)))
    assert clock.seen[-1] == "d"


async def test_without_memory_nothing_that_has_begun_waits(monkeypatch: pytest.MonkeyPatch) -> None:

    clock = Clock(TimeShares(1, lambda: False), monkeypatch)
    await clock.pass_(until=asyncio.gather(*(clock.job(client, 20) for client in "abc")))
    assert clock.seen.index("b") <= time_shares.SHORT + 1  # beside the other, once that is long
    assert clock.seen.index("c") <= 3 * (time_shares.SHORT + 1)


def test_uploads_keep_their_room_while_they_load_and_take_none_from_results(tmp_path: Path) -> None:
    quotas = Quotas(disk_mb=3, result_mb=1, owner_disk_mb=0.4)  # 1 MB of uploads
    store = Store(tmp_path, quotas)
    store.new_job("simulation-1", "simulation", b"{}")
    (store.begin_job("simulation-1")[0] / "result.npz").write_bytes(bytes(1_900_000))
    store.end_job("simulation-1", state="done", ended=1.0)
    one, two = "u-" + "0" * 20, "u-" + "1" * 20
    store.accounts.reserve(one, "", 600_000)
    with pytest.raises(Refusal, match="uploads would take more than the 1 MB"):
        store.accounts.reserve(two, "", 600_000)
    with pytest.raises(Refusal, match="ann keeps would take more"):
        store.accounts.reserve(two, "ann", 440_000)
    staged = store.stage(one, bytes(700_000))
    store.add_robot(one, staged, {"id": one}, "")
    store.unstage(staged)
    lied = store.stage(two, bytes(700_000))  # more than was told
    with pytest.raises(Refusal, match="uploads would take"):
        store.add_robot(two, lied, {"id": two}, "")
    store.unstage(lied)
    assert store.job("simulation-1") is not None
    assert size_of(tmp_path / "robots") == 700_000
    store.remove_robot(one)
    store.accounts.reserve(two, "", 1_000_000)
    store.close()


# A service with owners and a small disk


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    tokens = ("--token", "ann:one", "--token", "bob:two", "--token", "eve:three", "--admin", "eve")
    quotas = ("--quota", "disk_mb=10", "--quota", "result_mb=2", "--quota", "load_seconds=60")
    with serving(tmp_path_factory.mktemp("shared") / "data", *tokens, *quotas) as running:
        yield running


def client(served: Served, token: str) -> Served:
    return served.client(headers={"Authorization": f"Bearer {token}"})


@pytest.mark.some(1)
@pytest.mark.parametrize("what", ["robot", "simulation"])
def test_an_owner_lists_and_ends_its_own_and_an_administrator_all(shared: Served, what: str) -> None:
    with client(shared, "one") as ann, client(shared, "two") as bob, client(shared, "three") as eve:

        def made(http: Served) -> str:
            if what == "robot":
                return http.ask("/v1/robots", pendulum())["id"]
            return http.ask("/v1/simulations", RUN)["id"]

        path = {"robot": "/v1/robots", "simulation": "/v1/simulations"}[what]
        first, second = made(ann), made(bob)
        assert first != second
        assert made(ann) == first

        def listed(http: Served) -> set[str]:
            return {each["id"] for each in http.ask(path)} & {first, second}

        assert (listed(ann), listed(bob), listed(eve)) == ({first}, {second}, {first, second})
        bob.ask(f"{path}/{first}")  # who has the link may read
        assert bob.delete(f"{path}/{first}").json()["code"] == "forbidden"
        if what == "simulation":
            for verb in ("cancel", "run"):
                bob.ask(f"{path}/{first}/{verb}", {}, 403)
            assert ann.ask(f"{path}/{first}")["owner"] == "ann"
        ann.delete(f"{path}/{first}").raise_for_status()
        eve.delete(f"{path}/{second}").raise_for_status()
        assert listed(eve) == set()


def test_the_disk_quota_holds_while_compressed_uploads_come_at_once(shared: Served) -> None:
    folder = shared.log_file.parent / "data"
    with client(shared, "one") as http:
        kept = http.ask("/v1/simulations", RUN)["id"]

        def upload(number: int) -> httpx.Response:
            files = {"r.urdf": pendulum(name=f"r{number}"), "m.stl": bytes(2**21)}
            return http.post("/v1/robots", content=zipped(files), headers={"Content-Type": "application/zip"})

        with ThreadPoolExecutor(50) as pool:
            answers = list(pool.map(upload, range(50)))
        taken = [answer.json()["id"] for answer in answers if answer.status_code == 201]
        refused = [answer for answer in answers if answer.status_code != 201]
        assert 1 <= len(taken) <= 2  # the uploads' part is 4 MB
        assert {answer.status_code for answer in refused} <= {413, 503}
        assert any("its disk quota" in answer.text for answer in refused)
        assert size_of(folder) < 10 * 2**20
        http.ask(f"/v1/simulations/{kept}")
        for key in taken:
            http.delete(f"/v1/robots/{key}").raise_for_status()
        upload(0).raise_for_status()


@pytest.mark.slow
def test_an_owner_has_so_much_processor_time_a_day(tmp_path: Path) -> None:
    tokens = "--token", "ann:one", "--token", "bob:two"
    with serving(tmp_path / "data", *tokens, "--quota", "owner_seconds=0.2") as served, client(served, "one") as ann:
        ann.ask("/v1/scenes/validate", {"scene": "arm-swing"})

        def refused() -> httpx.Response | None:
            body = {**RUN, "duration": 0.5 + len(answers) / 100}
            answers.append(ann.post("/v1/simulations", json=body))
            return answers[-1] if answers[-1].status_code == 429 else None

        answers: list[httpx.Response] = []
        wait_until(refused)
        problem = answers[-1].json()
        assert (problem["code"], "ann has had the 0.2 s" in problem["detail"]) == ("no-time-left", True)
        assert 0 < int(answers[-1].headers["retry-after"]) <= 86_400
        with client(served, "two") as bob:
            assert bob.ask("/v1/simulations", RUN)["state"] == "done"
    assert "Traceback" not in served.log


def test_a_run_of_a_refused_sweep_is_refused_at_once_and_one_beyond_all_is_unknown(http: Served) -> None:
    vary = {"q.shoulder": {"range": [0.0, 1.0, 2_000_000]}}
    asked = {"scene": "arm-swing", "vary": vary, "duration": 0.5, "wait": 30}
    http.ask("/v1/sweeps", asked, 422)
    (key, *_) = (job["id"] for job in http.ask("/v1/sweeps"))
    assert http.ask(f"/v1/sweeps/{key}/runs/0", status=422)["code"] == "too-large"
    http.ask(f"/v1/sweeps/{key}/runs/{10**20}", status=400)


EXTREME: list[tuple[str, dict[str, Any]]] = [
    ("linearize", {"scene": "arm-swing", "q": [1e10, 0.0]}),
    ("linearize", {"scene": "arm-swing", "q": [1e300, 0.0]}),
    ("linearize", {"scene": "arm-swing", "v": [1e200, 0.0]}),
    *(("explain", {"scene": {"robot": "two_link", "effects": [
        {"type": "gravity"}, {"type": "joint-spring", "stiffness": {"elbow": stiffness}},
    ]}}) for stiffness in (1e12, 1e100, 1e300)),
]  # fmt: skip


@pytest.mark.some(1)
@pytest.mark.parametrize(("path", "body"), EXTREME)
def test_extreme_numbers_are_no_fault_of_the_service(http: Served, path: str, body: dict[str, Any]) -> None:
    answer = http.post(f"/v1/scenes/{path}", json=body)
    assert answer.status_code in (200, 422), answer.text
