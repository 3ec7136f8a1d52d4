"""Which pairs may touch: SRDFs, and all but some."""

import shutil
from pathlib import Path

import pytest

import twolink as tl
from tests.effects.bodies import solved
from tests.near import assert_near
from twolink.errors import SceneError
from twolink.robots.catalogue import catalogue_entry

fx = tl.effects


def named(scene: tl.Scene) -> tuple[set[str], dict[str, str]]:
    """The pairs of the scene's contact, and those left out with the reason."""
    pairs = next(effect for effect in scene.effects if isinstance(effect, fx.Contact)).selected(scene.robot)
    return {pair.name for pair in pairs.chosen}, dict(pairs.excluded)


def test_an_srdf_beside_the_urdf_leaves_its_pairs_out_of_self() -> None:
    panda = tl.load_robot("panda")
    chosen, excluded = named(tl.Scene(panda, effects=[fx.Contact(("self",))]))
    disabled = {name for name, why in excluded.items() if why == "by panda.srdf"}
    assert "panda_link0 - panda_link1" in disabled  # adjacent
    assert any({"panda_link3", "panda_link5"} == set(name.split(" - ")) for name in disabled)  # never, says the file
    assert not any({"panda_link3", "panda_link5"} == set(name.split(" - ")) for name in chosen)
    assert panda.visuals.srdf.states["default"]["panda_joint4"] == (-2.35619,)
    assert "panda.srdf" in str(panda.report)


def test_links_that_an_srdf_leaves_out_by_default(tmp_path: Path) -> None:
    """As in MoveIt: a link touches no other but those that are enabled, of which some are disabled again."""
    links = "".join(f"""<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
        iyz="0"/></inertial><collision><geometry><sphere radius="0.1"/></geometry></collision></link>"""
        for name in "abcd")  # fmt: skip
    joints = "".join(f"""<joint name="{name}" type="prismatic"><parent link="w"/><child link="{name}"/>
        <origin xyz="{k} 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
        for k, name in enumerate("abcd"))  # fmt: skip
    (tmp_path / "r.urdf").write_text(f'<robot name="r"><link name="w"/>{links}{joints}</robot>')
    (tmp_path / "r.srdf").write_text("""<robot name="r"><disable_default_collisions link="a"/>
        <enable_collisions link1="a" link2="b"/><enable_collisions link1="c" link2="a"/>
        <disable_collisions link1="a" link2="c"/></robot>""")
    chosen, excluded = named(tl.Scene(tl.load_robot(tmp_path / "r.urdf"), effects=[fx.Contact(("self",))]))
    assert {frozenset(name.split(" - ")) for name in chosen} == set(map(frozenset, ("ab", "bc", "bd", "cd")))
    assert {frozenset(name.split(" - ")) for name in excluded} == set(map(frozenset, ("ac", "ad")))


def test_joined_robots_keep_what_their_srdfs_say() -> None:
    panda = tl.load_robot("panda")
    one, _ = named(tl.Scene(panda, effects=[fx.Contact(("self",))]))
    two = tl.Scene(panda).with_object(panda, (1, 0, 0), name="right").with_effects([fx.Contact(("self",))])
    chosen, _ = named(two)
    assert one <= chosen
    assert {" - ".join(f"right_{link}" for link in name.split(" - ")) for name in one} <= chosen
    between = [name for name in chosen if len({link.startswith("right_") for link in name.split(" - ")}) == 2]
    shapes = {"panda_link0": 1} | {solid.link: 1 for solid in panda.solids}
    assert len(between) >= len(shapes) ** 2 - 1  # all but the two bases, which do not move


def test_a_urdf_without_its_srdf_has_other_pairs(tmp_path: Path) -> None:
    path = catalogue_entry("go1").path
    shutil.copy(path, tmp_path / "go1.urdf")
    share = [path.parents[3].parent]
    alone = tl.load_robot(tmp_path / "go1.urdf", root="free", package_dirs=share)
    beside = tl.load_robot("go1", root="free")
    pairs = [named(tl.Scene(robot, effects=[fx.Contact(("self",))]))[0] for robot in (alone, beside)]
    assert pairs[1] < pairs[0]


def test_all_but_these() -> None:
    scene = tl.Scene(tl.load_robot("world")).with_object("box").with_object("box").with_object("can")
    all_but = (("can", "box"), ("ground", "can"))
    chosen, excluded = named(scene.with_effects([fx.Contact(exclude=all_but)]))
    pairs = {frozenset(name.split(" - ")) for name in chosen}
    assert pairs == {frozenset(p) for p in (("box", "box_2"), ("box_2", "can"), ("box", "ground"), ("box_2", "ground"))}
    assert set(excluded.values()) == {"by the scene"}
    with pytest.raises(SceneError, match=r"exclude\[0\]\[1\].*'cann'.*did you mean 'can'"):
        scene.with_effects([fx.Contact(exclude=(("box", "cann"),))])
    with pytest.raises(SceneError, match="no two bodies may touch"):
        scene.with_effects([fx.Contact((("can", "box"),), exclude=(("box", "can"),))])


@pytest.mark.slow
def test_touch_sensors_feel_all_shapes_of_a_link() -> None:
    feet = [fx.Sphere(0.01, (x, y, -0.04)) for x, y in ((0.03, 0.0), (-0.03, 0.03), (-0.03, -0.03))]
    base = tl.Scene(tl.load_robot("world")).with_object("box").base
    effects = [fx.Gravity(), fx.Contact(("ground",), shapes={"box": tuple(feet)}), fx.TouchSensor("box", name="feet")]
    run = solved(base, effects, 0.1, [0, 0, 0.05, 0, 0, 0, 1], accuracy=1e-8)
    assert set(run.contact_forces) == {"box_0 - ground", "box_1 - ground", "box_2 - ground"}
    assert_near(run.sensors["feet"].values, [[0, 0, 0.5 * 9.81]] * len(run.sensors["feet"].t), 1e-9)
