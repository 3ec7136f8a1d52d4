"""The commands accuracy and methods, and what `run` says of the method."""

import contextlib
import json
from pathlib import Path

import pytest

import twolink as tl
from tests.command import answer, call, one_line
from twolink.integrate.steps.methods import METHODS

STUDY = ["accuracy", "arm-swing", "--duration", "0.5", "--methods", "rk45, dop853", "--tolerances", "1e-3,1e-6",
         "--repeats", "1"]  # fmt: skip


def test_accuracy_prints_and_writes(tmp_path: Path) -> None:
    outs = [part for name in ("x.png", "x.csv", "x.json") for part in ("--out", str(tmp_path / name))]
    done = call(*STUDY, *outs)
    assert (done.returncode, done.stderr) == (0, "")
    for part in ("two_link: 0.5 s", "its own error is", "rk45", "tolerance 1e-06", "a digit more", "wrote"):
        assert part in done.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.csv", "x.json", "x.png"]
    assert len(tl.Study.load(tmp_path / "x.json").rows) == 4


def test_accuracy_as_json() -> None:
    record = answer(*STUDY)
    assert [row["method"] for row in record["rows"]] == ["rk45", "rk45", "dop853", "dop853"]
    assert record["reference"]["error"] < 1e-15
    assert record["price_of_digits"][0]["accuracy"] == 0.1


MISUSED = {
    "method": (["--methods", "rk46"], "method: 'rk46' is unknown"),
    "no method": (["--methods", ","], "methods: no method is named"),
    "tolerance": (["--tolerances", "-1"], "tolerances: expected a number above 0"),
    "words": (["--tolerances", "small"], "tolerances: 'small' is not a list of numbers"),
    "duration": (["--duration", "0"], "above 0 s"),
    "ending": (["--out", "x.html"], "'.html' is not a format we know"),
    "budget": (["--budget", "0"], "budget: expected a number above 0"),
}


@pytest.mark.parametrize("case", MISUSED)
def test_misuse(case: str) -> None:
    arguments, part = MISUSED[case]
    one_line(call("accuracy", "arm-swing", *arguments), 2, part)


def test_ctrl_c_prints_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    def press(done: int, _total: int, _label: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr("twolink.cli.scenes.progress_bar", lambda: contextlib.nullcontext(press))
    done = call(*STUDY, "--json")
    assert (done.returncode, done.stderr) == (130, "twolink: interrupted; what was done is kept\n")
    record = json.loads(done.stdout)
    assert record["interrupted"]
    assert [row["method"] for row in record["rows"]] == ["rk45", "rk45"]


def test_methods_are_listed() -> None:
    rows = answer("methods")
    assert [row["name"] for row in rows] == list(METHODS)
    text = call("methods").stdout
    for method in METHODS.values():
        assert method.good_for in text
        assert method.source in text


def test_run_says_which_method_why_and_what_it_took() -> None:
    done = call("run", "arm-swing", "--duration", "1", "--method", "rk4", "--step", "0.01")
    for part in ("method   rk4, step 0.01 s (asked for)", "steps    100 steps", "solved in", "error bar"):
        assert part in done.stdout
    record = answer("run", "arm-swing", "--duration", "1", "--method", "dop853", "--tolerance", "1e-5")
    assert record["cost"]["tolerance"] == 1e-5
    assert record["error"] > 0


def test_run_in_quadruple_precision_prints_the_digits() -> None:
    record = answer("run", "arm-swing", "--duration", "0.5", "--precision", "quad", "--accuracy", "1e-20")
    assert record["error"] <= 1e-20
    assert all(len(digits.lstrip("-0.")) >= 30 for digits in record["q_precise"])
    assert float(record["q_precise"][0]) == record["q"][0]
