"""twolink sweep: a store, its status, a figure and a table."""

from pathlib import Path

import pytest

from tests.command import answer, call, one_line
from twolink.parts.sweeps.outputs import STATUS

pytest.importorskip("zarr")
ARM = ("sweep", "arm-swing", "--duration", "0.2", "--workers", "1")


def test_robots_vary_by_their_names(tmp_path: Path) -> None:
    names = "two_link, double_pendulum, no_such_robot"
    found = answer(*ARM, "--vary", f"robot={names}", "--outputs", "cost", "--out", str(tmp_path / "x.zarr"))
    assert (found["done"], found["failed"]) == (2, 1)


def test_a_sweep_from_the_command_line(tmp_path: Path) -> None:
    files = [str(tmp_path / name) for name in ("x.zarr", "x.png", "x.csv")]
    out = [text for file in files for text in ("--out", file)]
    vary = ("--vary", "q.elbow=-0.5:0.5:3", "--vary", "forearm.mass=1,2,-1")
    found = answer(*ARM, *vary, *out)
    assert (found["total"], found["done"], found["failed"]) == (9, 6, 3)
    assert found["written"] == files[1:]
    assert Path(files[2]).read_text().count("\n") == 10
    again = call(*ARM, *vary, *out[:2])
    assert again.returncode == 0, again.stderr
    assert "9 of 9 runs finished (100.0%); 3 failed" in again.stdout
    assert "expected at least 0, got -1" in again.stdout
    status = answer("sweep", "arm-swing", *out[:2], "--status")
    assert (status["total"], status["pending"]) == (9, 0)


def test_endings_in_capitals_are_the_same_formats(tmp_path: Path) -> None:
    files = [str(tmp_path / name) for name in ("X.ZARR", "X.PNG")]
    found = answer(*ARM, "--vary", "q.elbow=0,1", "--out", files[0], "--out", files[1])
    assert found["done"] == 2
    assert Path(files[1]).read_bytes().startswith(b"\x89PNG")


def test_help_says_what_a_status_and_a_mass_mean() -> None:
    text = call("sweep", "--help").stdout
    assert all(f"{code} {name}" in text for code, name in enumerate(STATUS))
    assert "LINK.mass alone keeps the link's centre of mass and its inertia" in text
    assert "see below" not in text


@pytest.mark.parametrize(("arguments", "code", "part"), [
    ((*ARM, "--out", "x.zarr"), 2, "give --vary"), ((*ARM, "--vary", "q.elbow=1"), 2, "one store"),
    ((*ARM, "--vary", "q.elbow=1,x", "--out", "x.zarr"), 2, "not a list of numbers"),
    ((*ARM, "--vary", "q.elbo=1", "--out", "x.zarr"), 2, "did you mean 'q.elbow'"),
    (("sweep", "arm-swing", "--out", "no.zarr", "--status"), 1, "no store of a sweep"),
])  # fmt: skip
def test_misuse(arguments: tuple[str, ...], code: int, part: str) -> None:
    one_line(call(*arguments), code, part)
