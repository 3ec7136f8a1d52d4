"""Two robots under comparison: right pairs, and faults that must be found with their place and cause."""

import json
import random
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.exchange.urdf_edits import RIGHT, child, faults, plain_urdf, text

ROBOTS = ("two_link", "kinova", "anymal", "double_pendulum_continuous", "squeezer", "so100", "baxter", "tiago_pro",
          "panda", "ur5", "talos_arm", "go1", "z1", "solo8", "bowler", "finger_edu", "hyq", "xarm7", "icub",
          "a1")  # fmt: skip


def right_pair(name: str, seed: int) -> tuple[str, str]:
    """A robot, and the same one written otherwise."""
    rng, a, b = random.Random(seed), plain_urdf(name), plain_urdf(name)
    for change in rng.sample(RIGHT, rng.randint(1, 3)):
        change(b, rng)
    return text(a), text(b)


@pytest.mark.some(8)
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("seed", range(10))
def test_no_false_alarm(name: str, seed: int) -> None:
    found = tl.compare_models(*right_pair(name, 100 * seed + len(name)))
    assert found.equal, str(found)
    assert max(found.dynamics.values(), default=0.0) < 1e-7


def pair_with(fault: str, k: int = 4) -> tuple[str, str, str]:
    """The Panda's arm, one with the fault; and the link or joint at fault."""
    texts, at = [], ""
    for faulty in (False, True):
        root = plain_urdf("panda")
        for n, inertial in enumerate(root.iter("inertial")):  # each with a rotation, and without symmetry
            child(inertial, "origin").attrib.update(rpy=f"0.3 {0.1 * n} 0.7", xyz=f"0.05 {0.01 * n} 0.02")
            child(inertial, "inertia").attrib.update(ixx="0.031", iyy="0.042", izz="0.053", ixy="0.001", ixz="0.002",
                                                     iyz="0.003")  # fmt: skip
        for joint in root.iter("joint"):
            child(joint, "dynamics").attrib.update(damping="0.4", friction="0.2")
        if fault in ("sign of ixy", "sign of iyz", "products dropped", "entries in another order"):
            for inertial in root.iter("inertial"):
                child(inertial, "origin").attrib.update(rpy="0 0 0")
        if faulty:
            at = faults(k)[fault][0](root)
        texts.append(text(root))
    return texts[0], texts[1], at


@pytest.mark.parametrize("fault", faults(0))
def test_seeded_faults_are_found_with_place_and_cause(fault: str) -> None:
    a, b, at = pair_with(fault)
    found = tl.compare_models(a, b)
    _, what, words = faults(0)[fault]
    named = [d for d in found.differences if d.what == what]
    assert named, str(found)
    assert repr(at) in named[0].where
    assert words in named[0].cause, str(found)
    also = {"upper limit": 2, "joint": 1}.get(what, 1)
    assert len(found.differences) == also, str(found)
    again = {str(d.what) for d in tl.compare_models(b, a).differences}
    assert what in again


def test_the_result_is_text_data_and_a_file(tmp_path: Path) -> None:
    a, b, _ = pair_with("mass scaled")
    found = tl.compare_models(a, b)
    assert "1 difference, 9 joints matched" in found.summary
    assert "<mass>" in found._repr_html_() or "&lt;mass&gt;" in found._repr_html_()
    record = json.loads(found.save(tmp_path / "d.json").read_text())
    assert record["equal"] is False
    assert record["differences"][0]["cause"] == "scaled by 1.1"


def test_a_flipped_axis_is_the_same_mechanism_in_other_coordinates() -> None:
    a, b, at = pair_with("axis flipped")
    found = tl.compare_models(a, b)
    assert [sign for name, _, sign, _ in found.joints if name == at] == [-1.0]
    assert max(found.dynamics.values()) < 1e-9
    a, b, at = pair_with("zero offset")
    found = tl.compare_models(a, b)
    np.testing.assert_allclose([abs(x) for name, _, _, x in found.joints if name == at], 0.3, atol=1e-9)
    assert max(found.dynamics.values()) < 1e-9


def test_limbs_that_one_sign_keeps_from_mirroring_are_named() -> None:
    a, b = plain_urdf("solo12"), plain_urdf("solo12")
    name = "FR_UPPER_LEG"
    for root in (a, b):
        for link, sign in (("FL_UPPER_LEG", 1.0), (name, -1.0)):
            inertia = next(e for e in root.iter("link") if e.get("name") == link).find("inertial")
            child(inertia, "inertia").set("ixy", repr((sign if root is a else 1.0) * 1e-5))
            child(inertia, "inertia").set("iyz", "0")
    found = tl.compare_models(text(a), text(b))
    faulty = [r for r in found.remarks if "sign of ixy" in r and name in r]
    assert len(faulty) == 1
    assert "(b)" in faulty[0]
    assert "sign of ixy" in found.differences[0].cause


BODY = """<inertial><origin xyz="0.1 0.02 0.03"/><mass value="1.5"/><inertia ixx=".01" iyy=".02" izz=".025" ixy="0.001"
ixz="0" iyz="0"/></inertial>"""


def coupled(leader: str, multiplier: float, offset: float = 0.1, axes: tuple[int, int, int] = (1, 1, 1)) -> str:
    """A chain of joints j1, j2, j3, of which j3 follows another; axes: 1 or -1 along y."""
    mimic = f'<mimic joint="{leader}" multiplier="{multiplier!r}" offset="{offset!r}"/>'
    joints = [f"""<joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>
        <origin xyz="0.2 0.1 0" rpy="0.3 0.2 0.1"/><axis xyz="0 {axis} 0"/>{mimic * (k == 3)}
        <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>""" for k, axis in enumerate(axes, 1)]  # fmt: skip
    links = "".join(f'<link name="l{k}">{BODY}</link>' for k in range(4))
    return f'<robot name="r">{links}{"".join(joints)}</robot>'


@pytest.mark.parametrize(("other", "differs"), [
    (coupled("j2", 50.0), True), (coupled("j1", 50.0004), True), (coupled("j1", 50.0), False),
    (coupled("j1", -50.0, axes=(-1, 1, 1)), False), (coupled("j1", -50.0, -0.1, axes=(1, 1, -1)), False),
    (coupled("j1", -50.0, 0.1, axes=(1, 1, -1)), True),
])  # fmt: skip
def test_followers_of_another_joint_or_by_another_relation_are_found(other: str, differs: bool) -> None:
    """An axis that points the other way turns the relation, too."""
    whats = [one.what for one in tl.compare_models(coupled("j1", 50.0), other).differences]
    assert ("mimic" in whats) == differs


def test_a_small_difference_of_gravity_is_named() -> None:
    one, other = (tl.load_robot("two_link", gravity=(0, 0, g)) for g in (-9.81, -9.81009))
    assert [each.what for each in tl.compare_models(one, other).differences] == ["gravity"]


@pytest.mark.parametrize("what", ["damping", "friction", "armature"])
def test_small_losses_are_compared_by_their_own_size(what: str) -> None:
    """Of small joints they are small: 5e-7 N m s is not 0."""

    def with_loss(value: float) -> str:
        numbers = {"damping": 0.0, "friction": 0.0, "armature": 0.0, what: value}
        dynamics = " ".join(f'{key}="{x!r}"' for key, x in numbers.items())
        return coupled("j1", 2.0).replace("<axis", f"<dynamics {dynamics}/><axis", 1)

    assert tl.compare_models(with_loss(5e-7), with_loss(5e-7)).equal
    for other in (5.0001e-7, 0.0):
        found = tl.compare_models(with_loss(5e-7), with_loss(other))
        assert [each.what for each in found.differences] == [what]
