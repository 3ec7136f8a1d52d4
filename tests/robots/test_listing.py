"""What there is, and what a load report prints."""

import pytest

import twolink as tl
from tests.urdf_text import joint, link, robot_of
from twolink.dynamics.robot_record import robot_record
from twolink.robots import catalogue_names, robots
from twolink.robots.joint_layout import urdf_kind


@pytest.mark.slow
def test_the_table_of_robots_gives_sizes_or_why_a_robot_is_refused() -> None:
    table = robots()
    rows = {row["name"]: row for row in table}
    assert tuple(rows) == catalogue_names()
    assert rows["anymal"] | {"mass": None} == {
        "name": "anymal", "from": "example-robot-data", "root": "free", "nq": 19, "nv": 18, "mass": None,
        "refused": None,
    }  # fmt: skip
    assert rows["two_link"]["mass"] == 4.0
    assert all(
        row["nv"] for row in table if not row["refused"] and row["name"] != "world"
    )  # with its usual root, every robot can move
    assert {name for name, row in rows.items() if row["refused"]} == {"romeo", "romeo_laas_small", "romeo_small"}
    assert all((row["nq"] is None) == bool(row["refused"]) for row in table)


def test_a_load_report_prints_its_statements_by_kind() -> None:
    report = tl.load_robot("double_pendulum").report
    for text in (repr(report), str(report)):
        assert text.splitlines()[0] == "double_pendulum.urdf"
        assert [line.split(":")[0].strip() for line in text.splitlines()[1:] if not line.startswith(" " * 8)] == [
            "read", "ignored", "repaired", "assumed",
        ]  # fmt: skip
        assert "joint damping" in text
    html = report._repr_html_()
    assert "<th>ignored</th>" in html
    odd = tl.load_robot("two_link").visuals.text.replace('robot name="two_link"', 'robot name="&lt;b&gt;"')
    assert "<b>" not in tl.load_robot(odd).report._repr_html_()


def test_links_of_no_mass_with_an_inertia_are_reported_and_count() -> None:
    text = robot_of(link("b", 0.0, (1.0, 1.0, 2.0)), joint("j", "continuous", "ground", "b"))
    rotor = tl.load_robot(text, unphysical="report")
    said = [f for f in rotor.report.assumed if "inertias that no real body has" in f.what]
    assert [f.names for f in said] == [("b",)]
    assert rotor.mass_matrix([1.0, 0.0])[0, 0] == 2.0


@pytest.mark.parametrize(("name", "kinds"), [("panda", {"revolute", "prismatic"}), ("bouncing_ball", {"prismatic"}),
                                            ("anymal", {"floating", "revolute"})])  # fmt: skip
def test_joints_have_the_words_of_a_urdf(name: str, kinds: set[str]) -> None:
    robot = tl.load_robot(name, root="free" if name == "anymal" else "fixed")
    assert {urdf_kind(robot.model, joint.index) for joint in robot.joints} == kinds
    assert {row["kind"] for row in robot_record(robot)["joints"]} == kinds
