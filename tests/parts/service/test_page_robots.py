"""Robots on the page: uploaded, dropped, chosen, moved, asked; and files that are none."""

import json
import re
import time
from pathlib import Path

import httpx
import numpy as np
import pytest

from tests.parts.service.page_driver import Page
from tests.parts.service.serving import pendulum
from tests.robots.test_bad_urdf import INERTIAL

pytestmark = [pytest.mark.browser, pytest.mark.slow]
VISUAL = '<visual><origin xyz="0 0 -0.5"/><geometry><box size="0.1 0.1 1"/></geometry></visual>'
BASE = f'<link name="base">{INERTIAL}</link>'
BAD = pendulum().replace('mass value="2"', 'mass value="-1"')


def test_from_a_new_robot_to_its_playing(page: Page, tmp_path: Path) -> None:
    """A newcomer's way."""
    (tmp_path / "mine.urdf").write_text(pendulum(VISUAL, name="mine"))
    page.open()
    page.upload(tmp_path / "mine.urdf")
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('mine: 1 joint')")
    assert "joint limits" in page.text("#report-body")
    page.wait_for("document.getElementById('sliders').innerText.includes('hinge')")
    page.choose("#sliders input[type=range]", "0.9")
    page.wait_for("document.getElementById('scene-json').value.includes('0.9')")
    page.wait_for("document.getElementById('expected')")
    page.run()
    page.choose("#speed", "0.1")  # so that it does not end before it is looked at
    assert page.moves()
    page.choose("#robot-select", "two_link")
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('two_link')")
    assert page.evaluate("document.getElementById('result').hidden")


def test_a_dropped_robot_and_a_free_base(page: Page) -> None:
    page.open()
    page.drop("dropped.urdf", pendulum(VISUAL, name="dropped").replace('<link name="base"/>', BASE))
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('dropped')")
    page.choose("#root", "free")
    page.wait_for("document.getElementById('robot-facts').innerText.includes('free base')")
    page.wait_for("document.querySelectorAll('#sliders .slider').length > 2")  # those of the fixed robot are two
    assert page.evaluate("document.querySelectorAll('#sliders .slider').length") == 7
    assert "pitch" in page.text("#sliders")


def test_a_folder_with_meshes_is_dropped(page: Page, tmp_path: Path) -> None:
    """As vendors give them: a URDF in a folder, which finds its mesh in another one; what else is there stays there."""
    mesh = '<visual><geometry><mesh filename="package://mine_description/meshes/part ü.obj"/></geometry></visual>'
    folder = tmp_path / "mine_description"
    for name in ("urdf", "meshes", "empty"):
        (folder / name).mkdir(parents=True)
    (folder / "urdf" / "mine.urdf").write_text(pendulum(mesh, name="in_a_folder"), "utf-8")
    (folder / "meshes" / "part ü.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n", "utf-8"
    )
    for number in range(150):  # a browser reads a hundred entries at a time
        (folder / "meshes" / f"more{number}.stl").write_bytes(b"solid s\nendsolid s\n")
    (folder / "README.md").write_text("not sent", "utf-8")
    page.open()
    page.drop_path(folder)
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('in_a_folder')")
    assert "part ü.obj" not in page.text("#report-body")  # it would name a mesh that is missing
    robot = page.evaluate(
        "fetch('/v1/robots').then(answer => answer.json()).then(all => all.find(one => one.name === 'in_a_folder').id)"
    )
    visuals = page.evaluate(f"fetch('/v1/robots/{robot}/visuals').then(answer => answer.json())")
    assert (len(visuals["pieces"]), visuals["skipped"]) == (1, [])


def test_a_link_written_by_hand_names_the_robot(page: Page) -> None:
    page.open("?robot=ur5")
    assert "6 joints" in page.text("#robot-facts")
    page.wait_for("location.hash.startsWith('#robot=ur5')")
    page.choose("#robot-select", "two_link")
    page.wait_for("location.hash.startsWith('#robot=two_link')")
    page.open(page.evaluate("location.search + location.hash"))  # what was chosen since counts
    assert "2 joints" in page.text("#robot-facts")


def test_a_quadruped_begins_on_the_ground_and_hangs_when_told_to(page: Page) -> None:
    page.open("?robot=solo12")
    assert page.text("#robot-facts").endswith("free base")
    page.wait_for("document.getElementById('effects').innerText.includes('Contact')")
    free = page.evaluate("location.hash")
    page.choose("#root", "fixed")
    page.wait_for("!document.getElementById('robot-facts').innerText.endsWith('free base')")
    page.wait_for(f"location.hash.startsWith('#robot=u-') && !{free!r}.startsWith(location.hash.split('&')[0])")
    page.open(page.evaluate("location.search + location.hash"))
    assert not page.text("#robot-facts").endswith("free base")


def test_sliders_move_the_robot(page: Page) -> None:
    page.open("#robot=two_link")
    before = page.robot()
    page.choose("#sliders input[type=range]", "0")
    page.choose("#sliders input[type=number]", "-1.2")
    page.wait_for("document.querySelector('#sliders input[type=range]').value === '-1.2'")
    assert page.moves(before)
    moved = page.robot()
    page.click("#start-reset")
    page.wait_for("document.querySelector('#sliders input[type=number]').value === '0.5'")
    assert page.moves(moved)


def test_objects_of_a_scene_are_drawn_and_their_sliders_move_them(page: Page) -> None:
    page.open("#scene=box-stack")
    page.wait_for("document.getElementById('play')?.classList.contains('playing')")
    page.click("#play")
    coloured = np.ptp(page.robot().astype(int), axis=-1) > 60
    assert coloured.mean() > 0.03  # arrows of forces alone: below 0.01
    assert page.text("#view-note") == ""
    before = page.robot()
    page.choose("#sliders input[type=range]", "0.3")
    assert page.moves(before)


def test_objects_are_drawn_though_a_scene_that_is_picked_meanwhile_cannot_be_had(page: Page) -> None:
    page.open("#robot=two_link")
    page.evaluate("""(() => {
        const plain = window.fetch;
        window.fetch = async (path, ...more) => {
            if (String(path).endsWith("/bowl")) throw new TypeError("lost");
            const answer = await plain(path, ...more);
            if (String(path).endsWith("/scenes/visuals")) await new Promise(after => setTimeout(after, 2000));
            return answer;
        };
    })()""")
    page.choose("#scene-select", "box-stack")
    page.wait_for("document.getElementById('view-note').textContent === 'Drawing…'")
    page.choose("#scene-select", "bowl")
    page.wait_for("document.querySelector('#scene-problem [role=alert]')")
    page.wait_for("document.getElementById('view-note').textContent === ''")


def test_a_bad_urdf_is_explained_where_it_was_given(page: Page, tmp_path: Path) -> None:
    (tmp_path / "bad.urdf").write_text(BAD)
    page.open()
    page.upload(tmp_path / "bad.urdf")
    page.wait_for("document.querySelector('#robot-problem [role=alert]')")
    problem = page.text("#robot-problem")
    assert "negative" in problem
    assert "What to do" in problem
    assert "link 'arm'" in problem
    assert page.text("#robot-facts").startswith("Still two_link")  # the page goes on with what it had
    (tmp_path / "bad.urdf").write_text("<robot ")
    page.upload(tmp_path / "bad.urdf")
    page.wait_for("document.querySelector('#robot-problem')?.innerText.includes('ot XML')")
    page.run()
    (tmp_path / "bad.urdf").write_text(pendulum(VISUAL, name="good"))
    page.upload(tmp_path / "bad.urdf")
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('good')")
    assert page.text("#robot-problem") == ""


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the client's socket, left to the end
def test_queries_are_answered_and_shown_as_programs(page: Page) -> None:
    page.open("#robot=two_link")
    page.choose("#query-name", "inverse-dynamics")
    page.choose("#in-q", "0.3 -0.7")
    page.choose("#in-a", "1, 0")
    page.evaluate("document.getElementById('query').requestSubmit()")
    page.wait_for("document.querySelector('#query-answer table')")
    robot = f"{page.url}/v1/robots/two_link"
    body = {"q": [0.3, -0.7], "v": [0, 0], "a": [1, 0]}
    tau = httpx.post(f"{robot}/inverse-dynamics", json=body, trust_env=False).json()["tau"]
    shown = page.evaluate("[...document.querySelectorAll('#query-answer td')].map(x => Number(x.title))")
    assert shown == pytest.approx(tau)
    curl = page.evaluate("document.getElementById('curl').textContent")
    assert f"{robot}/inverse-dynamics" in curl
    assert json.loads(re.search(r"-d '(.*)'", curl).group(1)) == body
    python = page.evaluate("document.getElementById('python').textContent")
    printed: list[object] = []
    exec(compile(python.replace("print(", "printed.append("), "shown", "exec"), {"printed": printed})
    assert np.asarray(printed[0]) == pytest.approx(tau)
    page.choose("#in-losses", "true")
    assert json.loads(re.search(r"-d '(.*)'", page.text("#curl")).group(1)) == body | {"losses": True}
    assert "losses=True" in page.text("#python")
    page.choose("#in-q", "0.3 nan?")
    page.evaluate("document.getElementById('query').requestSubmit()")
    page.wait_for("document.querySelector('#query-problem [role=alert]')")
    assert "not a number" in page.text("#query-problem")
    page.choose("#in-q", "0.3")
    page.evaluate("document.getElementById('query').requestSubmit()")
    page.wait_for("document.getElementById('in-q').getAttribute('aria-invalid') === 'true' "
                  "&& !document.getElementById('query-problem').innerText.includes('not a number')")  # fmt: skip


def test_every_query_can_be_asked(page: Page) -> None:
    page.open("#robot=two_link")
    for name in page.evaluate("[...document.getElementById('query-name').options].map(x => x.value)"):
        page.choose("#query-name", name)
        page.evaluate("document.getElementById('query-answer').replaceChildren()")
        page.evaluate("document.getElementById('query').requestSubmit()")
        page.wait_for("document.querySelector('#query-answer table')")


def test_a_late_drawing_does_not_replace_the_run(page: Page) -> None:
    page.open()
    page.evaluate("""(() => { const plain = window.fetch; window.fetch = async (...all) => {
        const answer = await plain(...all);
        if (all[0].endsWith('/visuals')) await new Promise(done => { window.drawNow = done; });
        window.moved ||= all[0].includes('/motion');
        return answer; }; })()""")
    page.choose("#scene-select", "bouncing-ball")
    page.wait_for("window.drawNow && document.getElementById('scene-json').value.includes('bouncing_ball')")
    page.click("#run-button")
    page.wait_for("window.moved")
    page.evaluate("setTimeout(window.drawNow, 1000)")
    page.wait_for("!document.getElementById('result').hidden")
    time.sleep(2.0)  # the drawing is there by now
    assert page.evaluate("!document.getElementById('playback').hidden")
    assert page.faults() == []


def test_hostile_names_stay_text(page: Page) -> None:
    name = "&lt;img src=x onerror=hacked=1&gt;"
    page.open()
    page.drop("h.urdf", pendulum(VISUAL, name=name).replace("hinge", name).replace('"arm"', f'"{name}"'))
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('<img')")
    page.run()
    assert page.evaluate("window.hacked") is None
    assert page.evaluate("document.querySelectorAll('img[src=x]').length") == 0
