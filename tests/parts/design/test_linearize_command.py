"""The command linearize: A, B, eigenvalues and the kind of equilibrium, as text, JSON and a figure."""

from pathlib import Path

import numpy as np

import twolink as tl
from tests.command import answer, call, one_line


def test_the_upright_arm_is_a_saddle_that_its_elbow_controls(tmp_path: Path) -> None:
    options = ["--q", "1.5707963267948966 0", "--input", "elbow", "--out", str(tmp_path / "eigenvalues.svg")]
    record = answer("linearize", "arm-swing", *options)
    linear = tl.linearize(tl.load_scene("arm-swing"), [np.pi / 2, 0.0], inputs=["elbow"])
    np.testing.assert_allclose(record["A"], linear.A, rtol=1e-12)
    np.testing.assert_allclose(record["B"], linear.B, rtol=1e-12)
    assert (record["stability"], record["controllable"], record["inputs"]) == ("saddle", 4, ["elbow"])
    assert (tmp_path / "eigenvalues.svg").stat().st_size > 1000


def test_people_read_the_same_and_misuse_is_one_line() -> None:
    done = call("linearize", "arm-swing", "--q", "-1.5707963267948966 0")
    assert "at rest: centre" in done.stdout
    assert "frequency Hz" in done.stdout
    assert "A =" in done.stdout
    one_line(call("linearize", "arm-swing", "--q", "0 0", "--input", "elbo"), 2, "elbow")
