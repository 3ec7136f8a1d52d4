"""scripts/: modules that texts name exist and can be imported; options, turns and tables of the runner."""

import importlib
import re
from pathlib import Path

import pytest

from scripts import runner

TOP = Path(__file__).parents[1]
MODULES = sorted(".".join(path.relative_to(TOP).with_suffix("").parts) for path in (TOP / "scripts").glob("*/*.py"))


def test_modules_that_texts_name_exist() -> None:
    files = [TOP / "README.md", *(TOP / "docs").rglob("*.md"), *(TOP / "twolink").rglob("*.py")]
    texts = "".join(path.read_text("utf-8") for path in files)
    named = {name.replace("/", ".") for name in re.findall(r"scripts[/.](?:benchmarks|studies|make)[/.]\w+", texts)}
    assert len(named) > 10
    assert named <= set(MODULES)


@pytest.mark.parametrize("name", MODULES)
def test_modules_can_be_imported_and_say_how_they_are_called(name: str) -> None:
    module = importlib.import_module(name)
    text = (TOP / f"{name.replace('.', '/')}.py").read_text("utf-8")
    if 'if __name__ == "__main__":' in text:
        assert f"python -m {name}" in (module.__doc__ or "") or "scripts/bench " in (module.__doc__ or "")


def test_options_come_from_their_defaults(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def given(*words: str) -> dict[str, object]:
        monkeypatch.setattr("sys.argv", ["x", *words])
        kinds = runner.Some(("a", "b"))
        return vars(runner.options("", rest=("all",), fast=False, step=float, counts=(1, 2), only=kinds, no_x=3))

    assert given() == {"rest": ["all"], "fast": False, "step": None, "counts": [1, 2], "only": ["a", "b"], "no_x": 3}
    changed = given("one", "--fast", "--step", "0.5", "--counts", "7", "--only", "b", "--no-x", "4")
    assert changed == {"rest": ["one"], "fast": True, "step": 0.5, "counts": [7], "only": ["b"], "no_x": 4}
    with pytest.raises(SystemExit):
        given("--only", "c")
    assert "unknown: c; known: a, b" in capsys.readouterr().err


def test_calls_take_turns_after_a_warm_up() -> None:
    called, clock = [], iter(range(100)).__next__
    calls = (lambda: called.append("a"), lambda: called.append("b"))
    assert runner.seconds_of(*calls, rounds=2, turn=2, before=1, clock=clock) == [1, 1]
    assert "".join(called) == "ab" + "aaabbb" * 2


def test_tables_are_printed_and_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(runner, "OUT", tmp_path)
    table = runner.Table("robot <6 | ns, one >8.1f | agrees to >3.0e")
    table.add("ur5", 12.34, 1e-9)
    table.add("arm", "refused", None)
    table.save("rows")
    lines = capsys.readouterr().out.splitlines()
    assert lines[:3] == ["robot   ns, one agrees to", "ur5        12.3     1e-09", "arm     refused"]
    assert (tmp_path / "rows.csv").read_text() == 'robot,"ns, one",agrees to\nur5,12.34,1e-09\narm,refused,\n'


def test_the_hooks_before_a_commit_are_the_checks_of_the_test_script() -> None:
    config = (TOP / ".pre-commit-config.yaml").read_text("utf-8")
    (version,) = re.findall(
        r"ruff-pre-commit\n    rev: v(\S+)\n    hooks: \[{id: ruff-check}, {id: ruff-format}\]", config
    )
    assert f"ruff=={version}\n" in (TOP / "scripts/constraints.txt").read_text("utf-8")
    hooks = re.findall(r"entry: (.*)}", config)
    checks = re.findall(r"^\.venv/bin/(?!python)\S.*?(?= >| \|\||$)", (TOP / "scripts/test").read_text("utf-8"), re.M)
    assert hooks == [check for check in checks if "ruff" not in check]
    assert len(checks) == len(hooks) + 2
