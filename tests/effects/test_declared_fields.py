"""Fields of effects that say beside their type which joints, links, directions and bounds they take."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any

import msgspec
import numpy as np
import pytest

import twolink as tl
from twolink.algorithms.motion import GROUND
from twolink.effects.checks import check_fields
from twolink.effects.effect import (
    AboveZero,
    CoordinateJoint,
    Direction,
    JointName,
    LinkName,
    NotNegative,
    PlaceName,
    SingleJoint,
    of,
)
from twolink.errors import SceneError
from twolink.scenes.file_format import scene_schema

ROBOT, EACH = tl.load_robot("bowler"), {"elbow": 1.0}


class Declared(msgspec.Struct, frozen=True):
    """A struct with a field of each kind. Each is right by itself."""

    above: AboveZero = 1.0
    least: NotNegative = 0.0
    way: Direction = (0.0, 0.0, 2.0)
    link: LinkName = "forearm"
    place: PlaceName = GROUND
    joint: JointName = "flight"
    single: SingleJoint = "elbow"
    coordinate: CoordinateJoint = "elbow"
    each: Mapping[SingleJoint, AboveZero] = msgspec.field(default_factory=EACH.copy)
    some: tuple[SingleJoint, ...] = ("elbow", "shoulder")
    or_none: Mapping[JointName, NotNegative] | None = None
    beside: Annotated[Mapping[str, NotNegative], of("each")] = {}
    with_all: Annotated[Mapping[str, float], of("each", each=True)] = msgspec.field(default_factory=EACH.copy)


def test_what_is_declared_is_taken() -> None:
    check_fields(Declared(), ROBOT)
    check_fields(Declared(or_none={"flight": 1.0}), ROBOT)


@pytest.mark.parametrize(("field", "value", "place", "what"), [
    ("above", 0.0, "above", "expected a number above 0"),
    ("above", "x", "above", "expected a finite number"),
    ("least", -1.0, "least", "of at least 0"),
    ("way", (0.0, 0.0, 0.0), "way", "expected a direction"),
    ("way", (0.0, 1.0), "way", "expected three"),
    ("link", "forarm", "link", "forearm"),
    ("link", GROUND, "link", "does not move"),
    ("place", "forarm", "place", "forearm"),
    ("joint", "elbo", "joint", "elbow"),
    ("single", "flight", "single", "one degree of freedom"),
    ("coordinate", "flight", "coordinate", "one degree of freedom"),
    ("each", {}, "each", "it names no joint"),
    ("each", {"elbo": 1.0}, "each", "elbow"),
    ("each", {"elbow": 0.0}, "each.elbow", "above 0"),
    ("each", 1.0, "each", "values by joint"),
    ("some", (), "some", "it names no joint"),
    ("some", ("elbow", "flight"), "some", "one degree of freedom"),
    ("or_none", {"elbo": 1.0}, "or_none", "elbow"),
    ("or_none", {}, "or_none", "it names no joint"),
    ("beside", {"shoulder": 1.0}, "beside", "joint with an each 'shoulder'"),
    ("beside", {"elbow": -1.0}, "beside.elbow", "of at least 0"),
    ("with_all", {"shoulder": 1.0}, "with_all", "joint with an each"),
    ("with_all", {}, "with_all", "no with_all for joint 'elbow'"),
])  # fmt: skip
def test_what_is_not_is_refused_at_its_place(field: str, value: Any, place: str, what: str) -> None:
    with pytest.raises(SceneError, match=what) as caught:
        check_fields(Declared(**{field: value}), ROBOT)
    assert caught.value.where == place


def test_a_continuous_joint_has_no_coordinate() -> None:
    robot, names = tl.load_robot("kinova"), ("j2s6s200_joint_1", "j2s6s200_joint_2")
    given = {"link": "j2s6s200_link_2", "joint": names[1], "some": names, "single": names[0],
             "each": {names[0]: 1.0}, "with_all": {names[0]: 1.0}}  # fmt: skip
    check_fields(Declared(**given, coordinate=names[1]), robot)
    with pytest.raises(SceneError, match="is continuous") as caught:
        check_fields(Declared(**given, coordinate=names[0]), robot)
    assert caught.value.where == "coordinate"


def test_the_schema_says_what_forms_may_offer() -> None:
    defs = scene_schema()["$defs"]
    spring, loop = defs["JointSpring"]["properties"], defs["PointLoop"]["properties"]
    assert spring["stiffness"]["propertyNames"] == {"format": "joint", "freedom": "coordinate"}
    assert loop["b"]["ground"] is True
    assert "ground" not in defs["AirDrag"]["properties"]["frame"]
    assert defs["Muscle"]["properties"]["length"]["exclusiveMinimum"] == 0.0
    assert defs["HingeLoop"]["properties"]["axis_a"]["format"] == "direction"


def test_arrays_and_numbers_of_numpy_are_taken_as_tuples_and_floats() -> None:
    def effects(number: Callable, whole: Callable, vector: Callable) -> list[tl.effects.Effect]:
        fx, size = tl.effects, vector((0.1, 0.2, 0.3))
        return [fx.Gravity(vector((0.0, 0.0, -9.81))), fx.Payload("forearm", number(0.5), size),
                fx.JointDamping({"elbow": whole(2)}), fx.Torque({"elbow": fx.Sine(number(1.0), vector(2.0))}),
                fx.Contact(shapes={"forearm": (fx.Box(size),)}),
                fx.Engage(fx.FrameWrench("forearm", size, point=size), at=number(0.5)),
                fx.Gear(fx.ActuatorLag(fx.Torque({"elbow": number(2.0)}), {"elbow": number(0.5)}), {"elbow": whole(3)}),
                ]  # fmt: skip

    robot, plain = tl.load_robot("two_link"), tuple(effects(float, int, lambda x: x))
    for number in (np.float32, np.float64):
        assert tl.Scene(robot, effects=effects(number, np.int64, np.array)).effects == plain
    assert tl.Scene(robot, effects=plain).effects == plain
