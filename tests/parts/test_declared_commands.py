"""Commands that functions of `tl` are: their examples are run, and options are read as the function takes them."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.command import answer, call, one_line
from twolink.cli.declared import DECLARED


@pytest.mark.parametrize("name", DECLARED)
def test_examples_run(name: str, tmp_path: Path) -> None:
    example = (DECLARED[name].load.__doc__ or "").partition("\b\n")[2]
    _, *words = shlex.split(example.replace("--out ", f"--out {tmp_path}/"))
    done = call(*words)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.splitlines()) > 3
    assert len(list(tmp_path.iterdir())) == words.count("--out")
    assert json.loads(call(*words, "--json").stdout)


def test_options_are_the_arguments_of_the_function(tmp_path: Path) -> None:
    found = answer("equilibria", "arm-swing", "--q", "shoulder=80 deg, elbow=0.1", "--inputs", "elbow")["found"]
    (ours,) = tl.equilibria(tl.load_scene("arm-swing"), [np.radians(80), 0.1], inputs=["elbow"])
    assert [one["q"] for one in found] == [ours.q.tolist()]
    assert np.shape(found[0]["B"]) == (4, 1)
    one_line(call("equilibria", "arm-swing", "--q", "1 2 3"), 2, "twolink: --q: expected shape")
    one_line(call("periodic", "arm-swing"), 2, "Missing option '--period'")
    one_line(call("energy", "arm-swing", "--out", str(tmp_path / "no" / "no" / "e.png")), 2, "there is no folder")
