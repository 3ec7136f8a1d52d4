"""The list of effects: complete, and what tab completion shows."""

import importlib
import pkgutil

import pytest

import twolink as tl
from twolink.effects import TYPES, effect_class
from twolink.effects.effect import Effect
from twolink.io.text import kebab_case


def test_every_effect_is_listed_and_completed() -> None:
    """The effect of a file has the file's name; the classes that others are built on are no effects to choose."""
    defined = set()
    for module in pkgutil.iter_modules(tl.effects.__path__):
        for name, value in vars(importlib.import_module(f"twolink.effects.{module.name}")).items():
            if kebab_case(name).replace("-", "_") == module.name and issubclass(value, Effect):
                defined.add(value)
    bases = {base for value in defined for base in value.__mro__[1:]}
    assert set(TYPES.values()) == {value.__name__ for value in defined - bases}
    assert set(TYPES.values()) | {"Polynomial", "Bezier", "Sine", "Sampled"} <= set(dir(tl.effects))
    assert all(getattr(tl.effects, name).__name__ == name for name in dir(tl.effects))


def test_types_of_scene_files() -> None:
    assert TYPES["joint-pd"] == "JointPD"
    assert effect_class("joint-pd") is tl.effects.JointPD
    assert "sampled" not in TYPES  # an input, no effect
    with pytest.raises(AttributeError, match="no attribute 'Gravty'"):
        tl.effects.Gravty  # noqa: B018
