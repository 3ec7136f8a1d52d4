"""Archives of arrays from strangers: each is read, or refused with a place, and takes no memory beyond its limit."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest

from tests.parts.service.hostile import _npy as npy
from tests.parts.service.urdfs import zipped
from twolink.parts.service.problems import Refusal
from twolink.parts.service.store.archives import read_npz, write_npz

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
