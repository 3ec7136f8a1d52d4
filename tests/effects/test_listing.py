"""The list of effects: complete, and what tab completion shows."""

import importlib
import pkgutil

import pytest

import twolink as tl
from twolink.effects import TYPES, USUAL_TYPES, effect_class
from twolink.effects.effect import Effect
from twolink.errors import SceneError
from twolink.io.text import kebab_case
from twolink.scenes.file import scene_from_data, scene_tables


def test_every_effect_is_listed_and_completed() -> None:
    """The classes that others are built on, and what holds a contact or a torque, are no effects to choose.

    A controller in Python is none of a scene file, nor is a network in a file of its own.
    """
    modules = [importlib.import_module(f"twolink.effects.{m.name}") for m in pkgutil.iter_modules(tl.effects.__path__)]
    classes = [value for module in modules for value in vars(module).values() if isinstance(value, type)]
    defined = {value for value in classes if issubclass(value, Effect)}
    bases = {base for value in defined for base in value.__mro__[1:]}
    others = {"Touching", "DofTorques", "HeldTorques", "HeldPositions", "Policy", "_Asking"}
    assert set(TYPES.values()) == {value.__name__ for value in defined - bases} - others
    assert set(TYPES.values()) | {"Polynomial", "Bezier", "Sine", "Sampled"} <= set(dir(tl.effects))
    assert all(getattr(tl.effects, name).__name__ == name for name in dir(tl.effects))


def test_types_of_scene_files() -> None:
    assert TYPES["joint-pd"] == "JointPD"
    assert effect_class("joint-pd") is tl.effects.JointPD
    assert "sampled" not in TYPES  # an input, no effect
    with pytest.raises(AttributeError, match="no attribute 'Gravty'"):
        tl.effects.Gravty  # noqa: B018


@pytest.mark.parametrize(("name", "meant"), [("CoulombFriction", "DryFriction"), ("PD", "JointPD"),
                                             ("Spring", "JointSpring"), ("Limits", "JointStops")])  # fmt: skip
def test_the_usual_names_of_others_are_hinted_at(name: str, meant: str) -> None:
    with pytest.raises(AttributeError, match=f"did you mean '{meant}'"):
        getattr(tl.effects, name)
    with pytest.raises(SceneError, match=f"did you mean '{kebab_case(meant)}'"):
        scene_from_data(scene_tables({"robot": "arm", "effects": [{"type": kebab_case(name)}]}), tl.load_robot)
    assert set(USUAL_TYPES.values()) <= set(TYPES)


def test_a_star_import_gives_what_is_listed() -> None:
    names: dict[str, object] = {}
    exec("from twolink.effects import *", names)  # as a user writes it
    assert set(dir(tl.effects)) <= set(names)
