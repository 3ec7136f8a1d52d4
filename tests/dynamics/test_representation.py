"""What a robot and its compiled functions show of themselves."""

import inspect

import twolink as tl


def test_a_robot_shows_sizes_joints_mass_source_and_remarks() -> None:
    robot = tl.load_robot("two_link", gravity=(0, 0, -1))
    text = repr(robot)
    for part in ("'two_link'", "nq 2", "nv 2", "joints 2 (shoulder, elbow)", "mass 4 kg", "two_link.urdf", "remarks"):
        assert part in text
    assert "\n" not in text
    html = robot._repr_html_()
    for part in ("<table>", "two_link", "shoulder, elbow", "4 kg", "two_link.urdf"):
        assert part in html
    assert "<b>" not in tl.load_robot(robot.visuals.text.replace('"shoulder"', '"&lt;b&gt;"'))._repr_html_()


def test_many_joints_are_cut() -> None:
    assert len(repr(tl.load_robot("talos", root="free"))) < 400


def test_compiled_functions_show_which_are_ready() -> None:
    compiled = tl.load_robot("two_link").compiled(["forearm.mass"])
    assert repr(compiled) == "<Compiled 'two_link': functions none yet, parameters forearm.mass>"
    compiled.certificate("bias")
    assert "functions bias," in repr(compiled)


def test_the_constructor_names_its_parameters() -> None:
    assert list(inspect.signature(tl.Robot).parameters) == ["name", "model", "report", "visuals"]
