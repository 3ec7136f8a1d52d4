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
