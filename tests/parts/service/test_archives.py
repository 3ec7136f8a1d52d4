"""Content as bytes: robots between processes, whole and found by id; and arrays from strangers, read or refused."""

import asyncio
import io
import os
import pickle
import tracemalloc
import weakref
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.hostile import _npy as npy
from tests.parts.service.serving import mesh, pendulum, stl, zipped
from tests.robots.test_bad_urdf import chain
from twolink.dynamics import Robot
from twolink.parts.service.http.components import RobotPool
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas
from twolink.parts.service.store.archives import RobotCache, memory_of, read_npz, read_robot, write_npz, write_robot


class IdsOnly:
    """A store that is asked for ids only: descriptions are long, and there may be many."""

    folder = Path()

    async def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments)

    def has_robot(self, _: str) -> bool:
        return False


def test_an_unknown_robot_is_refused_without_a_look_at_all_descriptions() -> None:
    pool = RobotPool(Quotas(), IdsOnly(), None, None)
    with pytest.raises(Refusal, match="two_link") as refused:
        asyncio.run(pool.require("two_lnk"))
    assert refused.value.status == 404


def test_robots_are_dropped_by_their_memory_and_those_in_use_live_on() -> None:
    large, small = tl.load_robot(chain(40, "revolute")), tl.load_robot("two_link")
    assert memory_of(large) > 2e6 > 1e6 > memory_of(small)
    cache = RobotCache(10)
    for number in range(30):
        cache.put(f"small {number}", small.with_gravity([0, 0, -1.0]))
    used = cache.put("used", large.with_gravity([0, 0, -1.0]))
    dropped = [weakref.ref(cache.put(f"large {number}", large.with_gravity([0, 0, -1.0]))) for number in range(20)]
    kept = [robot() for robot in dropped if robot() is not None]
    assert 2 <= len(kept) <= 4
    assert cache.get("used") is None
    assert cache.get("small 0") is None
    assert np.isfinite(used.gravity_torque(used.neutral)).all()
    oldest, next_one = (f"large {20 - len(kept) + k}" for k in range(2))
    assert cache.get(oldest) is kept[0]  # and so it is used last
    cache.put("another", large)
    assert cache.get(oldest) is kept[0]
    assert cache.get(next_one) is None


def test_a_robot_above_the_limit_is_kept_alone() -> None:
    cache, robot = RobotCache(0.1), tl.load_robot("two_link")
    assert cache.put("a", robot) is cache.get("a")
    cache.put("b", robot)
    assert cache.get("a") is None


@pytest.mark.parametrize(("name", "options"), [
    ("two_link", {}), ("anymal", {"root": "free"}), ("panda", {"mimic": True}),
])  # fmt: skip
def test_a_robot_comes_back_as_it_was(name: str, options: dict[str, Any]) -> None:
    robot = tl.load_robot(name, **options)
    again = read_robot(write_robot(robot))
    assert (again.name, again.joint_names, again.report) == (robot.name, robot.joint_names, robot.report)
    q, v = robot.random_state(3, seed=1)
    np.testing.assert_array_equal(again.bias(q, v), robot.bias(q, v))


def test_a_robot_with_meshes_comes_back(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(stl())
    robot = tl.load_robot(pendulum(mesh("package://a.stl")), package_dirs=[tmp_path])
    assert read_robot(write_robot(robot)).visual_model().ngeoms == 1


class Hostile:
    """Runs a call where it is unpickled."""

    def __init__(self, *call: Any) -> None:
        self.call = call

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return self.call[0], self.call[1:]


def test_nothing_else_is_read(tmp_path: Path) -> None:
    made = tmp_path / "made"
    robot = tl.load_robot("two_link")
    for content in (
        Hostile(os.mkdir, str(made)),
        Hostile(eval, f"__import__('os').mkdir({str(made)!r})"),
        Hostile(Robot, Hostile(os.mkdir, str(made)), robot.model, robot.report, robot.visuals),
        Hostile(np.load, str(made)),
        {"a": 1},
        Robot,
    ):
        with pytest.raises(pickle.UnpicklingError):
            read_robot(pickle.dumps(content))
    assert not made.exists()
    pickle.loads(pickle.dumps(Hostile(os.mkdir, str(made))))
    assert made.exists()  # so the check above can fail


HEAD = "{'descr': '<f8', 'fortran_order': False, 'shape': %s, }"


def member(shape: str) -> bytes:
    return npy(HEAD % shape, bytes(16))


def by_method(method: int) -> bytes:
    return zipped({"q.npy": member("(1, 2)")}, method)


def corrupt(body: bytes) -> bytes:
    return body[:60] + bytes(20) + body[80:]


REFUSED = {
    "a shape of truth values": zipped({"q.npy": member("(True, 2)")}),
    "64 axes": zipped({"q.npy": member(f"({'1, ' * 63} 2)")}),
    "65 axes": zipped({"q.npy": member(f"({'1, ' * 64} 2)")}),
    "a length beyond 64 bits": zipped({"q.npy": member(f"(0, {2**70})")}),
    "a shape of fractions": zipped({"q.npy": member("(1.0, 2)")}),
    "LZMA": by_method(zipfile.ZIP_LZMA),
    "corrupt LZMA": corrupt(by_method(zipfile.ZIP_LZMA)),
    "BZ2": by_method(zipfile.ZIP_BZIP2),
    "an unfinished header": zipped({"q.npy": npy("{'descr': (((", bytes(16))}),
    "a header of an indented line": zipped({"q.npy": npy("1\n  2\n 3", bytes(16))}),
    "a header of another type": zipped({"q.npy": npy(HEAD.replace("'<f8'", "'<f7'") % "(2,)", bytes(16))}),
    "a comment at its end": zipped({"q.npy": member("(2,)")})[:-2] + b"\x02\x00hi",
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_archive_that_is_not_ours_is_refused(name: str) -> None:
    with pytest.raises(Refusal) as refused:
        read_npz(io.BytesIO(REFUSED[name]), 10**6)
    assert refused.value.status == 400
    assert refused.value.where in ("body", "q.npy")
    assert refused.value.remedy


def test_a_list_of_many_members_is_not_read() -> None:
    body = io.BytesIO(zipped({f"a{k}.npy": b"" for k in range(20_000)}))
    tracemalloc.start()
    with pytest.raises(Refusal, match="too long"):
        read_npz(body, 10**6)
    assert tracemalloc.get_traced_memory()[1] < 10**6
    tracemalloc.stop()


def test_what_is_written_is_read_again_to_the_bit() -> None:
    rng = np.random.default_rng(0)
    arrays = {"q": rng.normal(size=(3, 5, 2)), "v": rng.normal(size=(2,)), "empty": np.zeros((0, 4))}
    plain = io.BytesIO()
    np.savez_compressed(plain, allow_pickle=True, **arrays)
    for body in (write_npz(arrays), plain.getvalue()):
        read = read_npz(io.BytesIO(body), 10**6)
        for name, array in arrays.items():
            assert np.array_equal(read[name], array)
            assert read[name].shape == array.shape
