"""The disk cache: what is stored is read again, and nothing else is opened or deleted."""

import concurrent.futures
import logging
import multiprocessing
import os
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.dynamics.states import close, states
from twolink.dynamics import compiled, kernels
from twolink.io import cache, fingerprints
from twolink.io.fingerprints import kernel_key
from twolink.lagrange.check import arm_urdf


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TWOLINK_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the kernels that are compiled from now on."""
    names: list[str] = []
    original = kernels.build
    monkeypatch.setattr(compiled, "build", lambda model, f, *a: names.append(f.name) or original(model, f, *a))
    return names


def ask() -> tl.Robot:
    """A new UR5 whose inverse dynamics are compiled or read."""
    robot = tl.load_robot("ur5")
    robot.compiled().certificate("inverse_dynamics")
    return robot


def test_a_second_robot_reads_what_the_first_built(folder: Path, built: list[str]) -> None:
    ask()
    assert built == ["inverse_dynamics"]
    assert len(list(folder.iterdir())) == 1
    assert folder.stat().st_mode & 0o777 == 0o700
    assert next(folder.iterdir()).stat().st_mode & 0o777 == 0o600
    robot = ask()
    assert built == ["inverse_dynamics"]
    q, v, w = states(robot, 5)
    close(robot.compiled().inverse_dynamics(q, v, w), robot.inverse_dynamics(q, v, w, engine="pinocchio"))


def test_compiling_is_logged_with_its_seconds(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "twolink"):
        ask()
        ask()
    messages = [record.getMessage() for record in caplog.records]
    assert len(messages) == 1  # the second reads the kernel
    assert messages[0].startswith("traced inverse_dynamics of ur5 in ")


DAMAGE = {
    "cut": lambda path: path.write_bytes(path.read_bytes()[:1000]),
    "empty": lambda path: path.write_bytes(b""),
    "a byte changed": lambda path: path.write_bytes(path.read_bytes()[:-1] + b"x"),
    "writable by others": lambda path: path.chmod(0o666),
    "a link": lambda path: (path.rename(path.parent.parent / "elsewhere"), path.symlink_to("../elsewhere")),
    "folder writable by others": lambda path: path.parent.chmod(0o777),
}


@pytest.mark.parametrize("how", DAMAGE)
def test_a_damaged_or_foreign_kernel_is_built_again(how: str, folder: Path, built: list[str]) -> None:
    ask()
    DAMAGE[how](next(folder.iterdir()))
    built.clear()
    robot = ask()
    assert built == ["inverse_dynamics"]
    q, v, w = states(robot, 3)
    close(robot.compiled().inverse_dynamics(q, v, w), robot.inverse_dynamics(q, v, w, engine="pinocchio"))


def test_a_foreign_file_is_not_unpickled(folder: Path, tmp_path: Path) -> None:
    """A pickle that would run code, put in the kernel's place without a matching digest, is not opened."""
    ask()
    place = next(folder.iterdir())
    harm = f"cos\nsystem\n(S'touch {tmp_path / 'harm'}'\ntR.".encode()
    place.write_bytes(cache.MAGIC + bytes(32) + harm)
    ask()
    assert not (tmp_path / "harm").exists()


@pytest.mark.parametrize("how", ["renamed", "stored"])
def test_a_kernel_of_another_robot_is_built_again(how: str, folder: Path, built: list[str]) -> None:
    """That of an arm of 1 kg, for one of 2 kg: by the digest of its name, or by the states of the certificate."""
    light, heavy = (tl.load_robot(arm_urdf(1, 1, mass, 1)) for mass in (1, 2))
    light.compiled().certificate("gravity_torque")
    name = kernel_key(heavy.model, ("gravity_torque", "|"))
    if how == "renamed":
        next(folder.iterdir()).rename(cache.kernel_path(name) or "")
        assert cache.load(name) is None
    else:
        cache.store(name, cache.load(kernel_key(light.model, ("gravity_torque", "|"))))
    q = np.array([0.1, 0.2])
    close(heavy.compiled().gravity_torque(q), heavy.gravity_torque(q))
    assert built == ["gravity_torque", "gravity_torque"]


def test_keys_tell_robots_functions_and_parameters_apart() -> None:
    texts = [arm_urdf(1, 1, 1, 1), arm_urdf(1, 1, 1, 1 + 1e-15), arm_urdf(1, 1 + 1e-15, 1, 1)]
    keys = {kernel_key(tl.load_robot(t).model, ("forward_dynamics",)) for t in texts}
    keys |= {kernel_key(tl.load_robot(texts[0]).model, parts) for parts in (("bias",), ("forward_dynamics", "x.mass"))}
    keys.add(kernel_key(tl.load_robot(texts[0], gravity=(0, 0, -9.8)).model, ("forward_dynamics",)))
    for axis in ("0 -1 1e-9", "0 -1 2e-9", "0.6 0.8 0"):
        keys.add(kernel_key(tl.load_robot(texts[0].replace("0 -1 0", axis)).model, ("forward_dynamics",)))
    assert len(keys) == 9
    assert kernel_key(tl.load_robot(texts[0]).model, ("bias",)) == kernel_key(tl.load_robot(texts[0]).model, ("bias",))


def test_keys_count_the_code_of_every_room_that_compiles() -> None:
    package = Path(fingerprints.__file__).parents[1]
    compiling = {path.relative_to(package).parts[0] for path in package.rglob("*.py")
                 if "program_named(" in path.read_text()}  # fmt: skip
    assert {"contact", "integrate"} <= compiling <= set(fingerprints.TRACED_ROOMS)


def test_files_of_others_in_the_folder_are_never_deleted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """TWOLINK_CACHE set to a folder with one's own files and folders: the limit is kept without them."""
    monkeypatch.setenv("TWOLINK_CACHE_MB", "1")
    folder.mkdir(mode=0o700)
    (folder / "below").mkdir()
    (folder / "folder.kernel").mkdir()
    others = [folder / "thesis.tex", folder / "data.kernel", folder / "below" / "old.kernel", folder / "k.kernel.bak"]
    for path in others:
        path.write_bytes(b"x" * 2**20)
        os.utime(path, (1, 1))  # the least recently used of all
    for i in range(8):
        cache.store(f"k{i}", np.zeros(50_000))
        os.utime(cache.kernel_path(f"k{i}") or "", (i + 2, i + 2))
    assert all(path.stat().st_size == 2**20 for path in others)
    own = [path for path in folder.glob("k?.kernel") if path not in others]
    assert sum(path.stat().st_size for path in own) <= 2**20
    assert cache.load("k7") is not None
    assert cache.load("k0") is None


def test_what_a_killed_process_left_is_deleted_and_copies_of_the_user_are_not(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TWOLINK_CACHE_MB", "1")
    cache.store("k0", np.zeros(50_000))
    content = (folder / "k0.kernel").read_bytes()
    left, copy = folder / ".k1.kernel.x2_3abc", folder / "k0.kernel.copy"
    for path in (left, copy):
        path.write_bytes(content[:-5])
        os.utime(path, (1, 1))
    for i in range(3):
        cache.store(f"k{i}", np.zeros(50_000))
    assert not left.exists()
    assert copy.exists()


def test_the_default_folder_is_the_systems(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TWOLINK_CACHE")
    assert os.path.basename(cache.location()) == "twolink"
    assert cache.location("x") == os.path.join(cache.location(), "x")


def test_without_a_folder_everything_works(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for setting in ("off", str(tmp_path / "file" / "cache")):
        monkeypatch.setenv("TWOLINK_CACHE", setting)
        assert cache.folder() is None
        assert cache.load("x") is None
        assert tl.load_robot("two_link").mass_matrix(np.zeros((9, 2)), engine="compiled").shape == (9, 2, 2)


def _in_a_process(folder: str) -> list[float]:
    os.environ["TWOLINK_CACHE"] = folder  # this process ends with the test
    return tl.load_robot("ur5").gravity_torque(np.full((9, 6), 0.3), engine="compiled")[0].tolist()


@pytest.mark.slow
def test_many_processes_at_once(folder: Path) -> None:
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(4, mp_context=context) as pool:
        answers = list(pool.map(_in_a_process, [str(folder)] * 8))
    assert all(a == answers[0] for a in answers)
    assert [p.suffix for p in folder.iterdir()] == [cache.SUFFIX]


def test_small_kernels_are_stored_without_a_look_at_all_others(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of years has thousands of them: each new one would take the time of reading all."""
    monkeypatch.setattr(cache, "_shrink", None)  # not called: it would be a TypeError
    for i in range(100):
        cache.store(f"k{i}", i)
    assert len(list(folder.glob("k*.kernel"))) == 100
    assert all(cache.load(f"k{i}") == i for i in range(100))
