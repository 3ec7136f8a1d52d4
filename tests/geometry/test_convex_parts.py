"""Concave meshes as convex parts: a ball in the notch of a U lies in it, and on the hull above it without parts."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from twolink.robots import convex_parts

E = tl.effects
OUTLINE = [(-0.5, 0.0), (0.5, 0.0), (0.5, 1.0), (0.2, 1.0), (0.2, 0.4), (-0.2, 0.4), (-0.2, 1.0), (-0.5, 1.0)]  # x, z
FRONT = [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4), (0, 5, 6), (0, 6, 7)]
NOTCH, RIM, RADIUS = 0.4, 1.0, 0.15  # m


@pytest.fixture
def letter(tmp_path: Path) -> Path:
    """A U of 1 m with a notch of 0.4 m x 0.6 m, from y = -0.5 to 0.5 m."""
    corners = [f"v {x} {y} {z}" for y in (-0.5, 0.5) for x, z in OUTLINE]
    back = [tuple(i + 8 for i in face[::-1]) for face in FRONT]
    sides = [face for i in range(8) for k in [(i + 1) % 8] for face in ((i, i + 8, k + 8), (i, k + 8, k))]
    faces = ["f " + " ".join(str(i + 1) for i in face) for face in (*FRONT, *back, *sides)]
    path = tmp_path / "letter.obj"
    path.write_text("\n".join(corners + faces))
    return path


def scene_of(letter: Path, concavity: float | None, height: float) -> tl.Scene:
    """The U fixed to the ground, and a ball above its notch."""
    scene = tl.Scene(tl.load_robot('<robot name="world"><link name="world"/></robot>'), effects=[E.Gravity()])
    scene = scene.with_object(E.Sphere(RADIUS), (0.0, 0.0, height), mass=1.0, name="ball").with_object(letter)
    return scene.with_effects([E.Gravity(), E.Contact((("ball", "letter"),), concavity=concavity)])


@pytest.mark.parametrize(("concavity", "floor"), [(0.02, NOTCH), (None, RIM)])
def test_a_ball_lies_in_the_notch_of_convex_parts_and_on_the_hull_without(
    letter: Path, concavity: float | None, floor: float
) -> None:
    scene = scene_of(letter, concavity, floor + RADIUS + 0.05)
    run = tl.simulate(scene, 0.5, contact="stepped", samples_per_second=20.0, verify=False)
    assert run.q[-1, 2] == pytest.approx(floor + RADIUS, abs=1e-4)
    assert np.abs(run.v[-1]).max() < 1e-6


def test_explain_tells_how_many_parts_a_mesh_has_and_names_it_once(letter: Path) -> None:
    text = str(tl.explain(scene_of(letter, 0.02, 2.0), duration=0.01))
    assert re.search(r"[3-9] pairs may touch: ball - letter\n", text)
    assert re.search(r"meshes count as convex parts: letter_0 [3-9]\n", text)
    hollow = str(tl.explain(scene_of(letter, 0.7, 2.0), duration=0.01))  # it is 0.6 m deep
    assert "1 meshes count as their convex hulls" in hollow
    assert "convex parts" not in hollow


def test_parts_are_kept_by_content_and_options(letter: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TWOLINK_CACHE", str(letter.parent))
    coacd, calls = pytest.importorskip("coacd"), list[float]()
    cut, made = coacd.run_coacd, list[object]()

    def cut_once(*args: object, **more: float) -> object:
        """What the first call gives, which takes a second: whether it is called is the question."""
        calls.append(more["threshold"])
        made.extend([] if made else [cut(*args, **more)])
        return made[0]

    monkeypatch.setattr(coacd, "run_coacd", cut_once)

    def parts(concavity: float) -> list[np.ndarray]:
        convex_parts._cut.cache_clear()
        chosen = scene_of(letter, concavity, 2.0).effects[1].selected(scene_of(letter, concavity, 2.0).robot).chosen
        return [np.array(pair.second.shape.vertices) for pair in chosen]

    first = parts(0.03)
    assert all(np.array_equal(a, b) for a, b in zip(first, parts(0.03), strict=True))
    assert calls == [0.03]
    parts(0.04)
    letter.write_text(letter.read_text().replace("0.4", "0.3"))
    parts(0.03)
    assert calls == [0.03, 0.04, 0.03]


def test_bad_concavity_and_a_missing_library_are_refused_by_name(letter: Path, monkeypatch) -> None:
    with pytest.raises(tl.errors.SceneError, match="above 0") as caught:
        scene_of(letter, 0.0, 2.0)
    assert caught.value.where.endswith("concavity")
    monkeypatch.setitem(sys.modules, "coacd", None)
    with pytest.raises(tl.errors.SceneError, match=r"coacd is not installed; pip install 'twolink\[decomposition\]'"):
        scene_of(letter, 0.02, 2.0)
