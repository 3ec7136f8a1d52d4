"""Hostile requests, made by rule: malformed, huge, nested, lying, and pointing where they should not."""

import io
import random
import struct
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tests.parts.service.serving import packed, pendulum, stl, zipped
from tests.robots.test_bad_urdf import BAD, GOOD, chain

JSON, NPZ, XML, ZIP = "application/json", "application/x-npz", "application/xml", "application/zip"
QUERY = "/v1/robots/two_link/forward-dynamics"


@dataclass(frozen=True)
class Case:
    name: str
    path: str
    body: bytes
    media: str


def cases() -> list[Case]:
    """All of them; the same every time."""
    return [*_json(), *_fuzzed_json(), *_npz(), *_urdfs(), *_fuzzed_urdfs(), *_zips(), *_scenes(), *_sweeps()]


def _json() -> Iterator[Case]:
    bodies = {
        "empty": b"",
        "not JSON": b"hello",
        "cut": b'{"q": [0, 0',
        "a list": b"[1, 2]",
        "null": b"null",
        "a number": b"1",
        "a string": b'"q"',
        "NaN": b'{"q": [NaN, 0]}',
        "Infinity": b'{"q": [Infinity, 0]}',
        "too large a number": b'{"q": [1e999, 0]}',
        "many digits": b'{"q": [' + b"9" * 10_000 + b", 0]}",
        "true in q": b'{"q": [true, 0]}',
        "null in q": b'{"q": [null, 0]}',
        "an object in q": b'{"q": [{}, 0]}',
        "q null": b'{"q": null}',
        "q a number": b'{"q": 1}',
        "q empty": b'{"q": []}',
        "q of empties": b'{"q": [[], []]}',
        "q too short": b'{"q": [0]}',
        "q mixed": b'{"q": [0, [0, 0]]}',
        "q too deep": b'{"q": [[[0, 0]]]}',
        "batches that do not fit": b'{"q": [[0, 0], [0, 0]], "v": [[0, 0], [0, 0], [0, 0]]}',
        "proto": b'{"__proto__": {}, "q": [0, 0]}',
        "class": b'{"q": [0, 0], "__class__": "os"}',
        "nested lists": b'{"q": ' + b"[" * 200_000 + b"]" * 200_000 + b"}",
        "nested objects": b'{"x":' * 100_000 + b"1" + b"}" * 100_000,
        "unfinished nest": b"[" * 1_000_000,
        "not UTF-8": b'{"q": [0, 0], "method": "\xff\xfe"}',
        "UTF-16": '{"q": [0, 0]}'.encode("utf-16"),
        "zero bytes": bytes(1000),
        "a lone surrogate": b'{"q": [0, 0], "method": "\\ud800"}',
        "two documents": b'{"q": [0, 0]}{"q": [0, 0]}',
        "comment": b'{"q": [0, 0]} // yes',
        "trailing comma": b'{"q": [0, 0,]}',
        "long key": b'{"' + b"k" * 1_000_000 + b'": 1}',
        "long method": b'{"q": [0, 0], "method": "' + b"m" * 1_000_000 + b'"}',
        "f_ext a list": b'{"q": [0, 0], "f_ext": [1]}',
        "f_ext short": b'{"q": [0, 0], "f_ext": {"tip": [1]}}',
        "f_ext nowhere": b'{"q": [0, 0], "f_ext": {"../../tip": [0, 0, 0, 0, 0, 0]}}',
        "many states": b'{"q": [' + b"[0]," * 200_000 + b"[0]]}",
    }
    for name, body in bodies.items():
        yield Case(f"json: {name}", QUERY, body, JSON)
    for path in ("two_link/coriolis", "two_link/kinematics", "two_link/derivatives", "..%2f..%2fetc/bias", "%00/bias"):
        yield Case(f"path {path}", f"/v1/robots/{path}", b'{"q": [0, 0, 0]}', JSON)
    yield Case("no media type of ours", QUERY, b'{"q": [0, 0]}', "application/x-python-pickle")


def _fuzzed_json() -> Iterator[Case]:
    rng, good = random.Random(7), b'{"q": [0.1, 0.2], "v": [0.3, 0.4], "tau": [1.0, 2.0]}'
    for number in range(40):
        body = bytearray(good)
        for _ in range(rng.randint(1, 4)):
            body[rng.randrange(len(body))] = rng.choice(b'"[]{},:\\\x00\xff')
        yield Case(f"fuzzed json {number}", QUERY, bytes(body), JSON)


def _npy(header: str, data: bytes) -> bytes:
    text = header.encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def _npz() -> Iterator[Case]:
    good = packed(q=np.zeros((4, 2)))
    head = "{'descr': %s, 'fortran_order': False, 'shape': %s, }"
    pickled = io.BytesIO()
    np.savez(pickled, q=np.array([object], dtype=object), allow_pickle=True)
    members = {
        "objects": head % ("'|O'", "(2,)"),
        "a huge shape": head % ("'<f8'", "(10**15, 2)"),
        "huge": head % ("'<f8'", "(1000000000000, 2)"),
        "negative": head % ("'<f8'", "(-1, 2)"),
        "wrong": head % ("'<f8'", "(7, 2)"),
        "strings": head % ("'<U4'", "(1,)"),
        "complex": head % ("'<c16'", "(1,)"),
        "fields": head % ("[('x', '<f8')]", "(2,)"),
        "code": "__import__('os').abort()",
        "nested": "(" * 5000 + ")" * 5000,
        "no dict": "[]",
        "long": "{" + " " * 60_000 + "}",
    }
    for name, header in members.items():
        yield Case(f"npz: {name}", QUERY, zipped({"q.npy": _npy(header, bytes(16))}), NPZ)
    others = {
        "empty": b"",
        "not a zip": b"hello",
        "json": b'{"q": [0, 0]}',
        "cut": good[:-30],
        "first half": good[: len(good) // 2],
        "pickle": pickled.getvalue(),
        "no arrays": zipped({}),
        "another file": zipped({"q.txt": "0 0"}),
        "other names": zipped({"x.npy": _npy(head % ("'<f8'", "(2,)"), bytes(16))}),
        "outside": zipped({"../q.npy": _npy(head % ("'<f8'", "(2,)"), bytes(16))}),
        "NaN": packed(q=np.full((3, 2), np.nan)),
        "wrong shape": packed(q=np.zeros((3, 5))),
        "0-d": packed(q=np.float64(1.0)),
        "wide broadcast": packed(q=np.zeros((2000, 1, 2)), v=np.zeros((1, 2000, 2))),
        "bomb": zipped({"q.npy": _npy(head % ("'<f8'", "(17000000, 2)"), bytes(272_000_000))}),
        "many": zipped({f"a{k}.npy": b"" for k in range(1000)}),
    }
    for name, body in others.items():
        yield Case(f"npz: {name}", QUERY, body, NPZ)
    rng = random.Random(3)
    for number in range(25):
        body = bytearray(good)
        for _ in range(3):
            body[rng.randrange(40, len(body))] ^= 1 << rng.randrange(8)
        if bytes(body) != good:
            yield Case(f"fuzzed npz {number}", QUERY, bytes(body[: rng.randrange(60, len(body))]), NPZ)


def _urdfs() -> Iterator[Case]:
    for name, (text, _) in BAD.items():
        yield Case(f"urdf: {name}", "/v1/robots", text.encode("utf-8", "surrogatepass"), XML)
    for count, kind in ((301, "revolute"), (5_001, "fixed"), (20_000, "revolute"), (150, "revolute")):
        yield Case(f"urdf: {count} chained {kind}", "/v1/robots", chain(count, kind).encode(), XML)
    others = {
        "a parameter entity": '<!DOCTYPE r [<!ENTITY % x SYSTEM "file:///etc/hostname"> %x;]><robot/>',
        "path": "/etc/passwd",
        "name": "panda",
        "empty": "",
        "spaces": " " * 1000,
        "only a declaration": '<?xml version="1.0"?>',
        "unknown encoding": '<?xml version="1.0" encoding="x-none"?><robot name="r"/>' + "\x00",
        "open": "<robot>" * 100_000,
        "long attribute": f'<robot name="{"n" * 5_000_000}"/>',
        "two robots": GOOD + GOOD,
    }
    for name, text in others.items():
        yield Case(f"urdf: {name}", "/v1/robots", text.encode(), XML)
    yield Case("urdf: UTF-16", "/v1/robots", GOOD.encode("utf-16"), XML)
    yield Case("urdf: not UTF-8", "/v1/robots", b"\xff\xfe\xfd" + GOOD.encode(), XML)
    for name, body in {
        "source a path": b'{"source": "/etc/passwd"}',
        "source above": b'{"source": "../../etc/passwd"}',
        "source a file": b'{"source": "urdf/arm.urdf"}',
        "source a URDF": b'{"source": "<robot/>"}',
        "both": b'{"source": "arm", "text": "<robot/>"}',
        "neither": b"{}",
        "a root it has not": b'{"source": "arm", "root": "flying"}',
        "gravity short": b'{"source": "arm", "gravity": [1]}',
        "no such joint": b'{"source": "arm", "lock": {"knee": 1}}',
    }.items():
        yield Case(f"upload: {name}", "/v1/robots", body, JSON)


def _fuzzed_urdfs() -> Iterator[Case]:
    rng = random.Random(11)
    for number in range(25):
        text = GOOD
        while text == GOOD:
            start = rng.randrange(len(GOOD))
            text = GOOD[:start] + rng.choice(("<", "&", "\x00")) + GOOD[start + rng.randrange(3) :]
        yield Case(f"fuzzed urdf {number}", "/v1/robots", text.encode(), XML)


def _zips() -> Iterator[Case]:
    urdf = pendulum()
    good = zipped({"a.urdf": urdf, "a.stl": stl()})
    bodies = {
        "empty": b"",
        "not a zip": b"PK\x03\x04 and no more",
        "cut": good[:-40],
        "LZMA": zipped({"a.urdf": urdf}, zipfile.ZIP_LZMA),
        "corrupt LZMA": (lzma := zipped({"a.urdf": urdf}, zipfile.ZIP_LZMA))[:60] + bytes(20) + lzma[80:],
        "no robot": zipped({"a.stl": stl()}),
        "above": zipped({"../a.urdf": urdf}),
        "absolute": zipped({"/tmp/a.urdf": urdf}),
        "backslashes": zipped({"..\\a.urdf": urdf}),
        "drive": zipped({"C:/a.urdf": urdf}),
        "many files": zipped({"a.urdf": urdf, **{f"{k}.stl": b"" for k in range(2000)}}),
        "bomb": zipped({"a.urdf": urdf, "a.stl": bytes(270_000_000)}),
        "not UTF-8": zipped({"a.urdf": b"\xff\xfe" + urdf.encode()}),
        "long name": zipped({"a.urdf": urdf, "d/" * 3000 + "a.stl": stl()}),
    }
    for name, body in bodies.items():
        yield Case(f"zip: {name}", "/v1/robots", body, ZIP)
    rng = random.Random(5)
    for number in range(20):
        yield Case(f"fuzzed zip {number}", "/v1/robots", good[: rng.randrange(4, len(good) - 22)], ZIP)


def _scenes() -> Iterator[Case]:
    deep = b'{"scene": {"robot": "arm", "effects": [' + b'{"a":' * 50_000 + b"1" + b"}" * 50_000 + b"]}}"
    bodies = {
        "empty": b"",
        "not JSON": b"{",
        "no scene": b"{}",
        "deep": deep,
        "NaN": b'{"scene": "arm-swing", "accuracy": NaN}',
        "a path": b'{"scene": "/etc/passwd"}',
        "a robot's path": b'{"scene": {"robot": "/etc/passwd"}}',
        "a robot's text": b'{"scene": {"robot": "<robot/>"}}',
        "an id outside": b'{"scene": {"robot": "u-/../../../../etc"}}',
        "many effects": b'{"scene": {"robot": "arm", "effects": [%s{"type": "x"}]}}' % (b'{"type": "gravity"},' * 5000),
        "endless": b'{"scene": "arm-swing", "duration": 1e300}',
        "a file": b'{"scene": {"robot": "arm", "effects": [{"type": "torque", "torque": {"elbow": '
        b'{"kind": "sampled", "file": "/etc/passwd"}}}]}}',
        "a number for a scene": b'{"scene": 1}',
    }
    for path in ("/v1/scenes/explain", "/v1/simulations", "/v1/studies"):
        for name, body in bodies.items():
            if not (path == "/v1/studies" and name == "NaN"):
                yield Case(f"{path}: {name}", path, body, JSON)


def _sweeps() -> Iterator[Case]:
    bodies = {
        "deep": b'{"q.elbow": ' + b"[" * 100_000 + b"]" * 100_000 + b"}",
        "NaN": b'{"q.elbow": [NaN]}',
        "empty": b'{"q.elbow": []}',
        "two rules": b'{"q.elbow": {"range": [0, 1, 3], "uniform": [0, 1]}}',
        "overflow": b'{"q.elbow": {"range": [-1e308, 1e308, 3]}}',
        "a path": b'{"../../q": [0]}',
        "mixed": b'{"q.elbow": [0, true, "x"]}',
        "texts": b'{"q.elbow": ["0", "1"]}',
        "a long name": b'{"' + b"q" * 1_000_000 + b'": [0]}',
    }
    for name, vary in bodies.items():
        yield Case(f"sweep: {name}", "/v1/sweeps", b'{"scene": "arm-swing", "wait": 20, "vary": ' + vary + b"}", JSON)
