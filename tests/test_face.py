"""One face: the same arguments in the same order wherever a scene is run, and a register of all codes of errors."""

import ast
import inspect
from pathlib import Path

import pytest

import twolink as tl

TOP = Path(__file__).parents[1]
ORDER = ["scene", "duration", "accuracy", "t_eval", "samples_per_second"]
RUNS = ["explain", "simulate", "simulate_many", "sensitivities", "gradient", "optimize", "sweep", "accuracy_study"]


@pytest.mark.parametrize("name", RUNS)
def test_arguments_are_the_same_in_the_same_order(name: str) -> None:
    given = inspect.signature(getattr(tl, name)).parameters
    assert list(given)[:2] == ORDER[:2]
    assert all(one.kind is one.KEYWORD_ONLY for one in list(given.values())[2:])
    assert [argument for argument in given if argument in ORDER] == [one for one in ORDER if one in given]
    assert given["duration"].default is given["t_eval"].default is None
    assert "samples_per_second" in given
    assert ("accuracy" in given) != (name == "accuracy_study")
    assert ("progress" in given) != (name == "explain")


def codes_in(text: str) -> set[str]:
    """The texts that a source gives as codes of failures: code=..., code = ..., failure(...)."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        values: list[ast.expr] = []
        if isinstance(node, ast.keyword) and node.arg == "code":
            values = [node.value]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "failure":
            values = node.args[:1]
        elif isinstance(node, ast.Assign):
            pairs = zip(node.targets, [node.value], strict=False)
            if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = zip(node.targets[0].elts, node.value.elts, strict=False)
            values = [value for target, value in pairs if isinstance(target, ast.Name) and target.id == "code"]
        choices = [[x.body, x.orelse] if isinstance(x, ast.IfExp) else getattr(x, "values", [x]) for x in values]
        parts = [part for choice in choices for part in choice]
        found |= {part.value for part in parts if isinstance(part, ast.Constant) and isinstance(part.value, str)}
    return found - {""}


def test_every_code_is_in_the_register_and_every_entry_is_a_code() -> None:
    texts = [path.read_text("utf-8") for path in (TOP / "twolink").rglob("*.py")]
    register, raised = tl.errors.codes(), set[str]().union(*map(codes_in, texts))
    assert raised - set(register) == set()
    assert [code for code in register if not any(f'"{code}"' in text for text in texts)] == []
    assert all(when.endswith(".") and remedy for when, remedy in register.values())


def test_a_code_that_is_not_in_the_register_is_found() -> None:
    new = 'raise SceneError("x", code="new-one")\nwhere, code = "y", "other"\nraise failure("third", 0.0)'
    assert codes_in(new) == {"new-one", "other", "third"}
