"""Several services that share a PostgreSQL database and an object store, with no stickiness between them."""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.parts.service.serving import Served, pendulum, serving, wait_until
from tests.parts.service.test_jobs import SLOW, ended, events, started
from tests.parts.service.test_sweeps import begun
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store import accounts
from twolink.parts.service.store.accounts import today
from twolink.parts.service.store.store import Store

pytest.importorskip("psycopg")
pytest.importorskip("obstore")
pytestmark = pytest.mark.skipif(not (shutil.which("initdb") and shutil.which("pg_ctl")), reason="needs PostgreSQL")
RUN = {"scene": "arm-swing", "duration": 0.5, "wait": 0}


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """The URL of a PostgreSQL server of its own, which listens in its folder only; root starts it as its own user."""
    is_root = os.geteuid() == 0
    as_user = ["runuser", "-u", "postgres", "--"] if is_root else []
    folder = Path(tempfile.mkdtemp(prefix="twolink-postgresql-"))  # pytest's folders are closed to other users
    if is_root:
        shutil.chown(folder, "postgres")

    def run(*command: str) -> None:
        subprocess.run([*as_user, *command], check=True, stdout=subprocess.DEVNULL, cwd=folder)

    run("initdb", "-D", str(folder / "data"), "-U", "twolink", "--auth", "trust", "--no-sync", "-E", "UTF8")
    options = f"-c listen_addresses= -c unix_socket_directories={folder} -c fsync=off"
    run("pg_ctl", "-D", str(folder / "data"), "-w", "-l", str(folder / "log"), "-o", options, "start")
    try:
        yield f"postgresql://twolink@/postgres?host={folder}"
    finally:
        run("pg_ctl", "-D", str(folder / "data"), "-m", "immediate", "stop")
        shutil.rmtree(folder)


@pytest.fixture
def shared(server: str, tmp_path: Path) -> Iterator[tuple[str, str]]:
    """The URLs of a new database, and of a folder as the object store."""
    import psycopg

    with psycopg.connect(server, autocommit=True) as connection:
        connection.execute("DROP SCHEMA public CASCADE")
        connection.execute("CREATE SCHEMA public")
    return server, f"file://{tmp_path}/objects"


@pytest.fixture
def stores(shared: tuple[str, str], tmp_path: Path) -> Iterator[list[Store]]:
    """Two stores of the same."""
    opened = [Store(tmp_path / name, Quotas(disk_mb=40, result_mb=20), *shared) for name in "ab"]
    yield opened
    for store in opened:
        store.close()


@contextlib.contextmanager
def services(folder: Path, shared: tuple[str, str], names: str, *options: str) -> Iterator[list[Served]]:
    with contextlib.ExitStack() as stack:
        urls = "--database", shared[0], "--store", shared[1]
        yield [stack.enter_context(serving(folder / name, *urls, *options)) for name in names]


def test_without_its_object_store_a_service_is_not_ready(tmp_path: Path, shared: tuple[str, str]) -> None:
    """It says so, without saying where the store is, and works on what needs none."""
    objects, away = tmp_path / "objects", tmp_path / "away"
    with services(tmp_path, shared, "a") as (http,):
        http.ask("/ready")
        objects.rename(away)
        objects.write_text("no folder")
        wait_until(lambda: http.get("/ready").status_code == 503)
        problem = http.ask("/ready", status=503)
        assert problem["code"] == "storage-failed"
        assert str(tmp_path) not in str(problem)
        http.ask("/health")
        objects.unlink()
        away.rename(objects)
        wait_until(lambda: http.get("/ready").status_code == 200)


def test_a_nul_in_a_path_names_nothing(tmp_path: Path, shared: tuple[str, str]) -> None:
    with services(tmp_path, shared, "a") as (http,):
        for path in ("/v1/simulations/a%00b", "/v1/robots/a%00b", "/v1/scenes/a%00b", "/v1/sweeps/a%00b/result"):
            http.ask(path, status=404)


# Leases


def test_a_job_is_claimed_once(stores: list[Store]) -> None:
    keys = [f"simulation-{k:020x}" for k in range(40)]
    for key in keys:
        stores[0].new_job(key, "simulation", b"{}")

    def claimed(store: Store) -> list[str]:
        return [row[0] for rows in iter(lambda: store.leases.claim(3), []) for row in rows]

    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(claimed, stores)
    assert sorted(one + other) == keys


def test_who_had_least_is_first(stores: list[Store]) -> None:
    for k, owner in enumerate(("ann", "ann", "bob")):
        stores[0].new_job(f"simulation-{k:020x}", "simulation", b"{}", owner)
    stores[0].accounts.spend("ann", 3.0)
    assert [row[2] for row in stores[1].leases.claim(2, day=today())] == ["bob", "ann"]


def test_a_silent_process_loses_its_job_and_cannot_end_it(stores: list[Store], monkeypatch: pytest.MonkeyPatch) -> None:
    (a, b), key = stores, "simulation-00000000000000000000"
    a.new_job(key, "simulation", b"{}")
    for tried in range(1, accounts.TRIES + 1):
        assert a.begin_job(key) is not None
        assert b.begin_job(key) is None
        assert a.leases.beat(key, {"fraction": 0.5}) is False
        assert b.leases.expire() == []
        monkeypatch.setattr(accounts, "LEASE", -1.0)
        assert b.leases.expire() == [(key, "queued" if tried < accounts.TRIES else "interrupted")]
        monkeypatch.undo()
        assert a.leases.beat(key, None) is None
    assert not a.leases.has(key)
    a.new_job(key, "simulation", b"{}")
    a.begin_job(key)
    monkeypatch.setattr(accounts, "LEASE", -1.0)
    b.leases.expire()
    assert b.begin_job(key) is not None
    assert a.end_job(key, state="done") is False
    assert b.end_job(key, state="failed") is True
    job = a.job(key)
    assert job is not None
    assert job.state == "failed"
    a.new_job(key, "simulation", b"{}")
    a.begin_job(key)
    b.leases.cancel(key)
    assert a.leases.beat(key, None) is True
    assert b.leases.expire() == [(key, "cancelled")]


def test_room_for_uploads_is_taken_once(stores: list[Store]) -> None:
    """Fifty uploads at once on two services never take more than there is."""

    def reserved(k: int) -> bool:
        with contextlib.suppress(Exception):
            stores[k % 2].accounts.reserve(f"u-{k:020x}", "", 2**20)
            return True
        return False

    with ThreadPoolExecutor(50) as pool:
        taken = sum(pool.map(reserved, range(50)))
    kept = stores[0].accounts.by_owner("loading")[""]
    assert kept == taken * 2**20
    assert 0 < kept <= 10 * 2**20


# Services


@pytest.mark.slow
def test_what_one_service_is_given_another_has(tmp_path: Path, shared: tuple[str, str]) -> None:
    def objects() -> list[Path]:
        return [path for path in (tmp_path / "objects" / "results").rglob("*") if path.is_file()]

    with services(tmp_path, shared, "ab") as (first, second):
        robot = first.ask("/v1/robots", pendulum())["id"]
        second.ask(f"/v1/robots/{robot}/gravity-torque", {"q": [0.5]})
        scene = {"robot": robot, "q": {"hinge": 0.5}, "effects": [{"type": "gravity"}]}
        asked = {"scene": scene, "duration": 0.5, "wait": 25}
        job = second.ask("/v1/simulations", asked)
        assert job["state"] == "done"
        path = f"/v1/simulations/{job['id']}"
        assert first.ask(path)["result"] == job["result"]
        contents = [http.get(f"{path}/result?format=csv").content for http in (first, second)]
        assert contents[0] == contents[1]
        assert contents[0].startswith(b"t,")
        cancelled_elsewhere(first, second)
        assert objects()
        first.delete(path).raise_for_status()
        second.ask(f"{path}/result", status=404)
        assert not objects()


def cancelled_elsewhere(first: Served, second: Served) -> None:
    """A job that runs behind the first is watched and cancelled at the second."""
    path = first.begin(SLOW)
    started(second, path)
    with second.stream("GET", f"{path}/events") as stream:
        lines = stream.iter_lines()
        assert next(lines) == "event: progress"
        second.post(f"{path}/cancel")
        assert "event: end" in lines
    assert ended(second, path)["state"] == "cancelled"
    assert first.ask(path)["state"] == "cancelled"


@pytest.mark.slow
@pytest.mark.parametrize(("which", "how"), [(0, signal.SIGKILL), (2, signal.SIGKILL), (1, signal.SIGTERM)])
def test_of_a_hundred_jobs_none_is_lost_or_done_twice_when_a_service_is_killed(
    which: int, how: signal.Signals, tmp_path: Path, shared: tuple[str, str]
) -> None:
    quotas = "--quota", "queue=200", "--quota", "jobs=1"
    with services(tmp_path, shared, "abc", *quotas) as running:
        count_ends(shared[0])
        reader = running[(which + 1) % 3]
        asked = [{**RUN, "duration": 0.5 + k / 1000} for k in range(100)]
        paths = [running[k % 2].begin(body) for k, body in enumerate(asked)]
        assert len(set(paths)) == 100

        def states() -> list[str]:
            return [reader.ask(path)["state"] for path in paths]

        wait_until(lambda: states().count("done") > 20)
        running[which].process.send_signal(how)
        running[which].process.wait(60)
        wait_until(lambda: set(states()) == {"done"}, 400)
        times = completions(shared[0])
        assert sorted(times) == sorted(path.rpartition("/")[2] for path in paths)
        assert set(times.values()) == {1}
        for path in paths:
            reader.ask(f"{path}/result?points=2")


def count_ends(url: str) -> None:
    """Have the database write down whenever a job is done."""
    import psycopg

    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("""
            CREATE TABLE ends (id TEXT);
            CREATE FUNCTION note() RETURNS trigger LANGUAGE plpgsql AS
                $$ BEGIN INSERT INTO ends VALUES (NEW.id); RETURN NEW; END $$;
            CREATE TRIGGER note AFTER UPDATE OF state ON jobs FOR EACH ROW
                WHEN (NEW.state = 'done') EXECUTE FUNCTION note();
        """)


def completions(url: str) -> dict[str, int]:
    """How often each job was done."""
    import psycopg

    with psycopg.connect(url) as connection:
        return dict(connection.execute("SELECT id, count(*) FROM ends GROUP BY id").fetchall())


@pytest.mark.slow
def test_another_service_goes_on_with_the_sweep_of_one_that_was_killed(tmp_path: Path, shared: tuple[str, str]) -> None:
    with services(tmp_path, shared, "ab") as (first, second):
        path = begun(first)
        objects = tmp_path / "objects" / "results" / path.rpartition("/")[2]
        wait_until(lambda: len(list(objects.glob("sweep.zarr/status/c/*/*"))) >= 2)
        stored = len(list(objects.glob("sweep.zarr/status/c/*/*")))
        first.kill()
        wait_until(lambda: "is queued" in second.log)
        done = next(job["progress"]["done"] for _, job in events(second, path) if (job["progress"] or {}).get("done"))
        assert done >= stored
        job = ended(second, path)
        assert (job["state"], job["result"]["done"]) == ("done", 6400)
