"""Values that an effect takes from the URDF act as those given by joint, on robots that differ in nothing else.

Compiled code is kept by a name of all that it is made from: what an effect reads from the model must be in it.
"""

import pytest

import twolink as tl
from twolink import effects as fx
from twolink.lagrange.check import arm_urdf


def arm(friction: float, effort: float) -> tl.Robot:
    """Two rods; friction [N m] and effort limits [N m] of both joints in the URDF."""
    joint = f'<dynamics friction="{friction}"/></joint>'
    return tl.load_robot(arm_urdf(1, 1, 1, 1).replace('effort="1000"', f'effort="{effort}"').replace("</joint>", joint))


def pd(effort: object) -> fx.JointPD:
    return fx.JointPD({"elbow": 1.0}, {"elbow": 50.0}, {"elbow": 1.0}, effort=effort)


CASES = {
    "smooth friction": (fx.SmoothFriction(scale=0.1),
                        lambda f, _: fx.SmoothFriction({"shoulder": f, "elbow": f}, 0.1)),
    "dry friction": (fx.DryFriction(), lambda f, _: fx.DryFriction({"shoulder": f, "elbow": f})),
    "dry friction, stuck": (fx.DryFriction(static={"elbow": 9.0}),
                            lambda f, _: fx.DryFriction({"shoulder": f, "elbow": f}, {"elbow": 9.0})),
    "effort": (pd("urdf"), lambda _, effort: pd({"elbow": effort})),
}  # fmt: skip


@pytest.mark.some(2)
@pytest.mark.parametrize("case", CASES)
def test_values_of_the_urdf_act_as_those_given_by_joint(case: str) -> None:
    from_urdf, by_joint = CASES[case]
    for friction, effort in ((0.5, 5.0), (3.0, 2.0)):
        robot = arm(friction, effort)
        runs = [
            tl.simulate(
                tl.Scene(robot, [0.5, 0.2], effects=[fx.Gravity(), effect]), 0.5, accuracy=1e-8, method="dop853"
            )
            for effect in (from_urdf, by_joint(friction, effort))
        ]
        assert abs(runs[0].q - runs[1].q).max() <= runs[0].error.max() + runs[1].error.max()
