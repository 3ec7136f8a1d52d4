"""The page in a real browser: from opening it to a playing uploaded robot, and what goes wrong on the way."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from tests.parts.service.page_driver import READY, Page
from tests.parts.service.serving import serving
from tests.parts.service.urdfs import INERTIAL, pendulum, zipped
from tests.show.browser import Browser
from twolink.show.playback import VIEWER

FOLDER = Path(__file__).parents[3] / "twolink" / "parts" / "service" / "page"
VISUAL = '<visual><origin xyz="0 0 -0.5"/><geometry><box size="0.1 0.1 1"/></geometry></visual>'
BASE = f'<link name="base">{INERTIAL}</link>'
BAD = pendulum().replace('mass value="2"', 'mass value="-1"')


def test_nothing_in_the_page_points_outside_or_stands_inline() -> None:
    """The policy would refuse it; here is which file it is in."""
    for path in (*FOLDER.rglob("*"), *VIEWER.iterdir()):
        text = path.read_text("utf-8")
        outside = [url for url in re.findall(r"https?://[^\s\"'<>)]+", text) if url != "http://www.w3.org/2000/svg"]
        assert outside == [], path.name
        assert not re.search(r"\sstyle=|\son\w+=\"|<style|javascript:", text), path.name
    html = (FOLDER / "index.html").read_text("utf-8")
    assert re.findall(r"<script[^>]*>(.*?)</script>", html, re.DOTALL) == [""]
    ids = set(re.findall(r'\bid="([^"]+)"', html)) | {"expected", "in-wrench-frame", "in-wrench"}
    for path in FOLDER.glob("*.js"):
        assert set(re.findall(r'byId\("([^"]+)"\)', path.read_text("utf-8"))) <= ids, path.name


@pytest.mark.slow
@pytest.mark.browser
def test_every_control_has_a_name(page: Page) -> None:
    page.open()
    page.run()
    nodes = page.browser.call("Accessibility.getFullAXTree")["nodes"]
    kinds = {"button", "combobox", "textbox", "slider", "spinbutton", "switch", "checkbox", "tab", "link", "image"}
    named = [(node["role"]["value"], node.get("name", {}).get("value", "")) for node in nodes if not node["ignored"]]
    assert [node for node in named if node[0] in kinds and not node[1].strip()] == []
    assert len([node for node in named if node[0] == "image"]) >= 5  # the robot and four plots say what they show
    assert page.evaluate("document.querySelectorAll('h1').length") == 1


@pytest.mark.browser
def test_a_bundled_scene_runs_plots_and_plays(page: Page) -> None:
    page.open()
    assert page.evaluate("document.getElementById('robot-select').value") == "two_link"
    assert "2 joints" in page.text("#robot-facts")
    assert re.search(r"≈ [\d.]+ (µs|ms|s)", page.text("#price"))
    assert len(np.unique(page.robot().reshape(-1, 3), axis=0)) > 200
    page.run()
    assert page.text("#results-title").startswith("The paper's two-link arm")
    assert "≤" in page.text("#summary .good")
    assert page.evaluate("document.querySelectorAll('#plots canvas').length") == 4
    assert min(page.colours(i) for i in range(4)) > 20
    page.choose("#speed", "0.1")  # so that it does not end before it is paused
    assert page.moves()
    page.click("#play")
    assert page.evaluate("document.getElementById('play').getAttribute('aria-label')") == "Play"
    assert not page.moves(seconds=1)
    page.choose("#scrub", "2.5")
    assert page.text("#clock") == "2.50 s"
    page.choose("#speed", "0.25")


@pytest.mark.slow
@pytest.mark.browser
def test_the_plots_zoom_hide_and_move_the_robot(page: Page) -> None:
    page.open()
    page.run()
    page.click("#play")
    left, top, width, height = page.box("#plots canvas")
    middle = top + height / 2
    page.mouse("mouseMoved", left + width / 2, middle)  # pointing at a moment shows it: values, clock, robot
    moment = page.text("#clock")
    assert 3.5 < float(moment.split()[0]) < 6.5
    value = float(page.text("#plots .legend .value").replace("−", "-"))
    job = page.evaluate("fetch('/v1/simulations').then(x => x.json()).then(x => x.find(j => j.state === 'done').id)")
    path = f"/v1/simulations/{job}/result?format=json&points=5000"
    columns = httpx.get(page.url + path, trust_env=False).json()["columns"]
    assert value == pytest.approx(np.interp(float(moment.split()[0]), columns["t"], columns["q.shoulder"]), abs=0.05)
    before = page.robot()
    page.box("#plots canvas")
    page.mouse("mouseMoved", left + width * 0.7, middle)
    assert page.text("#clock") != moment
    assert (page.robot() != before).any()
    left, top, width, height = page.box("#plots canvas")
    middle = top + height / 2
    whole = page.colours(1), page.evaluate("document.querySelectorAll('#plots canvas')[1].toDataURL()")
    drag: dict[str, Any] = {"button": "left", "buttons": 1}
    page.mouse("mousePressed", left + width * 0.3, middle)
    for part in (0.35, 0.45):
        page.browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=left + width * part, y=middle, **drag)
    page.mouse("mouseReleased", left + width * 0.45, middle)
    zoomed = page.evaluate("document.querySelectorAll('#plots canvas')[1].toDataURL()")
    assert zoomed != whole[1]  # all plots share the time that is shown
    for clicks in (1, 2):
        page.mouse("mousePressed", left + width * 0.5, middle, clicks)
        page.mouse("mouseReleased", left + width * 0.5, middle, clicks)
    assert page.evaluate("document.querySelectorAll('#plots canvas')[1].toDataURL()") != zoomed
    page.click("#plots .legend button")
    assert page.evaluate("document.querySelector('#plots .legend button').getAttribute('aria-pressed')") == "false"
    page.evaluate("document.querySelector('#plots canvas').focus()")
    page.press("Home", 36)
    assert page.text("#clock") == "0.00 s"
    page.press("ArrowRight", 39)
    assert page.text("#clock") != "0.00 s"
    assert "elbow" in page.evaluate("document.getElementById('announce').textContent")  # the shoulder is hidden


@pytest.mark.slow
@pytest.mark.browser
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


@pytest.mark.slow
@pytest.mark.browser
def test_a_dropped_robot_and_a_free_base(page: Page) -> None:
    page.open()
    page.drop("dropped.urdf", pendulum(VISUAL, name="dropped").replace('<link name="base"/>', BASE))
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('dropped')")
    page.choose("#root", "free")
    page.wait_for("document.getElementById('robot-facts').innerText.includes('free base')")
    page.wait_for("document.querySelectorAll('#sliders .slider').length > 2")  # those of the fixed robot are two
    assert page.evaluate("document.querySelectorAll('#sliders .slider').length") == 7
    assert "pitch" in page.text("#sliders")


@pytest.mark.slow
@pytest.mark.browser
def test_a_zip_with_its_urdf(page: Page, tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(zipped({"a/zipped.urdf": pendulum(VISUAL, name="zipped")}))
    page.open()
    page.upload(tmp_path / "a.zip")
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('zipped')")


@pytest.mark.slow
@pytest.mark.browser
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


@pytest.mark.slow
@pytest.mark.browser
def test_a_link_written_by_hand_names_the_robot(page: Page) -> None:
    page.open("?robot=ur5")
    assert "6 joints" in page.text("#robot-facts")
    page.wait_for("location.hash.startsWith('#robot=ur5')")
    page.choose("#robot-select", "two_link")
    page.wait_for("location.hash.startsWith('#robot=two_link')")
    page.open(page.evaluate("location.search + location.hash"))  # what was chosen since counts
    assert "2 joints" in page.text("#robot-facts")


@pytest.mark.slow
@pytest.mark.browser
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


@pytest.mark.slow
@pytest.mark.browser
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


@pytest.mark.slow
@pytest.mark.browser
def test_an_effect_is_switched_off_and_another_added(page: Page) -> None:
    page.open("#scene=arm-human")
    first = page.text("#operations")
    page.click("#effects [role=switch]")
    page.wait_for(f"document.getElementById('operations').innerText !== {json.dumps(first)} "
                  "&& document.getElementById('expected')")  # fmt: skip
    fewer = page.text("#operations")
    assert int(re.sub(r"\D", "", fewer.split("operations")[0])) < int(re.sub(r"\D", "", first.split("operations")[0]))
    assert "gravity" not in page.evaluate("document.getElementById('scene-json').value")
    page.choose("#add-effect", "Springs", stays=False)
    page.wait_for("document.querySelectorAll('#effects li').length === 3")
    page.wait_for("document.querySelectorAll('#effects .price')[2].innerText !== ''")
    assert "Joint spring" in page.text("#effects")


@pytest.mark.browser
def test_the_price_follows_the_accuracy(page: Page) -> None:
    page.open()
    page.choose("#accuracy", "12")
    assert page.text("#accuracy-value") == "1e-12"
    page.wait_for("document.getElementById('expected')")
    assert page.evaluate("document.getElementById('accuracy').getAttribute('aria-valuetext')") == "1e-12"


@pytest.mark.slow
@pytest.mark.browser
def test_events_are_listed_and_lead_there(page: Page) -> None:
    page.open("#scene=bouncing-ball")
    page.run()
    assert "events" in page.text("#events h3")
    assert "impact" in page.text("#events")
    page.click("#events button")
    assert page.text("#clock").startswith("0.45")


@pytest.mark.slow
@pytest.mark.browser
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


@pytest.mark.slow
@pytest.mark.browser
def test_a_bad_scene_is_explained_in_the_scene(page: Page) -> None:
    page.open()
    page.evaluate("document.getElementById('scene-json-details').open = true")
    page.choose("#scene-json", "{nonsense")
    page.click("#scene-apply")
    page.wait_for("document.getElementById('scene-problem').innerText.includes('not JSON')")
    scene = {"robot": "two_link", "effects": [{"type": "joint-damping", "damping": {"no_joint": 1}}]}
    page.choose("#scene-json", json.dumps(scene))
    page.click("#scene-apply")
    page.wait_for("document.getElementById('scene-problem').innerText.includes('no_joint')")
    assert "effects[0]" in page.text("#scene-problem code")
    scene["effects"] = [{"type": "gravity"}]
    page.choose("#scene-json", json.dumps(scene))
    page.click("#scene-apply")
    page.wait_for("document.getElementById('scene-problem').innerText === ''")
    page.run()


@pytest.mark.slow
@pytest.mark.browser
def test_an_accuracy_out_of_reach_offers_a_shorter_run(page: Page) -> None:
    """Double precision cannot keep 1e-9 for 40 s of a chaotic swing: a button runs what can be kept."""
    page.open("#robot=two_link")
    page.choose("#sliders input[type=number]", "1.6")
    page.choose("#accuracy", "9")
    page.choose("#duration", "40")
    page.choose("#precision", "double")
    page.click("#run-button")
    page.wait_for("document.querySelector('#run-problem button')")
    assert "double precision" in page.text("#run-problem")
    assert re.match(r"Run [\d.]+ s", page.text("#run-problem button"))
    page.click("#run-problem button")
    page.wait_for("!document.querySelector('#run-problem .problem')")  # a quick look has shown a result before
    page.wait_for("!document.getElementById('result').hidden")
    assert page.text("#run-problem") == ""


@pytest.mark.slow
@pytest.mark.browser
def test_a_job_that_others_wait_for_is_not_cancelled(page: Page) -> None:
    """The error bar of a quick look is the run that Run asks for: to wait no longer for one is not to end the other."""
    page.open()
    asked = page.evaluate("""(async () => {
      const { Job, jobControls } = await import(`${document.baseURI.split("#")[0]}page/jobs.js`);
      const [fetched, asked] = [window.fetch, []];
      window.fetch = async (path, options) => {
        if (!path.startsWith("v1/tests")) return fetched(path, options); // of the page itself
        asked.push(path);
        await new Promise(done => setTimeout(done, 50));
        return new Response(JSON.stringify({ id: "x", state: "running" }));
      };
      for (const cancel of [false, true]) {
        const job = new Job("tests", jobControls("job", "").parts, () => {});
        const run = job.run({});
        job.drop(cancel);
        await run;
      }
      window.fetch = fetched;
      return asked;
    })()""")
    assert asked == ["v1/tests", "v1/tests", "v1/tests/x/cancel"]


@pytest.mark.slow
@pytest.mark.browser
def test_a_run_is_cancelled(page: Page) -> None:
    page.open()
    page.choose("#method", "midpoint")
    page.choose("#duration", "500")
    page.choose("#accuracy", "3")
    page.click("#run-button")
    page.wait_for("!document.getElementById('cancel-button').hidden")
    page.wait_for("/Running|Queued/.test(document.getElementById('run-status').innerText) "
                  "|| document.querySelector('#run-problem .problem')")  # fmt: skip
    page.evaluate("document.getElementById('cancel-button').click()")
    page.wait_for("document.getElementById('cancel-button').hidden")
    assert not page.evaluate("document.getElementById('run-button').disabled")


@pytest.mark.slow
@pytest.mark.browser
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


@pytest.mark.slow
@pytest.mark.browser
def test_every_query_can_be_asked(page: Page) -> None:
    page.open("#robot=two_link")
    for name in page.evaluate("[...document.getElementById('query-name').options].map(x => x.value)"):
        page.choose("#query-name", name)
        page.evaluate("document.getElementById('query-answer').replaceChildren()")
        page.evaluate("document.getElementById('query').requestSubmit()")
        page.wait_for("document.querySelector('#query-answer table')")


@pytest.mark.slow
@pytest.mark.browser
def test_the_accuracy_study_is_drawn(page: Page) -> None:
    page.open()
    page.click("#tab-study")
    page.choose("#study-duration", "0.5")
    page.wait_for("document.querySelector('#study-methods input[value=dop853]')")
    for name in ("rk4", "taylor"):
        page.evaluate(f"document.querySelector('#study-methods [value={name}]').click()")
    page.evaluate("document.getElementById('study-settings').open = true")
    page.choose("[aria-label='Study tolerances']", "1e-3 1e-6")
    page.choose("[aria-label='Study repeats']", "2")
    page.click("#study-button")
    page.wait_for("document.querySelector('#study-result img')?.naturalWidth > 0")
    job = page.evaluate("fetch('/v1/studies').then(x => x.json()).then(x => x[0].request)")
    assert (job["methods"], job["tolerances"], job["repeats"]) == (["rk45", "dop853"], [1e-3, 1e-6], 2)
    assert "dop853" in page.text("#study-result table")


@pytest.mark.slow
@pytest.mark.browser
def test_earlier_runs_are_shown_again(page: Page) -> None:
    page.open("#scene=arm-human")
    page.run()
    page.open("#scene=arm-swing")
    page.click("#tab-past")
    page.wait_for("document.querySelector('#past .past-title')")
    page.evaluate("[...document.querySelectorAll('#past li')].find(x => x.innerText.includes('human arm'))"
                  ".querySelector('button').click()")  # fmt: skip
    page.wait_for("document.getElementById('results-title').innerText.includes('human arm')")


@pytest.mark.slow
@pytest.mark.browser
def test_the_keyboard_reaches_run(page: Page) -> None:
    page.open()
    assert page.evaluate("document.activeElement === document.body")
    page.tab()
    assert page.text(":focus") == "Skip to the run button"
    page.press("Enter", 13, "\r")
    page.open()
    seen = []
    for _ in range(120):
        seen.append(page.tab())
        if seen[-1] == "run-button":
            break
    assert {"robot-select", "file", "scene-select", "accuracy", "run-button"} <= set(seen)
    page.press("Enter", 13, "\r")
    page.wait_for("!document.getElementById('result').hidden")


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.parametrize(("width", "height"), [(360, 740), (768, 1024)])
def test_the_page_fits_small_screens(page: Page, width: int, height: int) -> None:
    page.browser.resize(width, height, mobile=True)
    page.open()
    page.evaluate("document.querySelectorAll('details').forEach(x => { x.open = true; })")
    page.run()
    for tab in ("tab-study", "tab-past", "tab-query"):
        page.evaluate(f"document.getElementById('{tab}').click()")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.moves()


@pytest.mark.slow
@pytest.mark.browser
def test_the_page_is_dark_when_the_system_is(page: Page) -> None:
    dark = {"name": "prefers-color-scheme", "value": "dark"}
    page.browser.call("Emulation.setEmulatedMedia", features=[dark])
    page.open()
    assert page.browser.screenshot().mean() < 80
    assert page.robot().mean() < 100


@pytest.mark.slow
@pytest.mark.browser
def test_the_page_outlives_the_service(tmp_path: Path, browser: Browser) -> None:
    with serving(tmp_path / "data") as gone:
        page = Page(browser, gone.url)
        page.open()
        page.run()
        gone.kill()
    page.click("#effects [role=switch]")
    page.wait_for("!document.getElementById('banner').hidden")
    assert "does not answer" in page.text("#banner")
    assert not page.evaluate("document.getElementById('result').hidden")
    page.click("#run-button")
    page.wait_for("document.querySelector('#run-problem .problem')")
    assert not page.evaluate("document.getElementById('run-button').disabled")
    with serving(tmp_path / "data", "--port", gone.url.rpartition(":")[2]):
        page.wait_for("document.getElementById('banner').hidden")
        page.run()
        page.click("#effects [role=switch]")
        page.wait_for("document.getElementById('expected')")
        page.run()
    assert page.faults() == []


@pytest.mark.slow
@pytest.mark.browser
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


@pytest.mark.browser
def test_a_robot_moves_on_arrival_and_its_error_bar_follows(page: Page) -> None:
    page.open(until="document.getElementById('play')?.classList.contains('playing')")
    assert page.evaluate("location.hash") in ("", "#scene=arm-swing")  # whoever gets the address sees the same
    page.wait_for(VERIFIED)
    assert page.text("#summary").count("≤") == 1
    assert page.evaluate("document.getElementById('play').classList.contains('playing')")


# The looks at three angles of the shoulder; the answer to one of them waits until the others have been shown.
LATE = """(async late => { window.asked = null;
  const plain = window.fetch, sent = []; let free, seen = 0;
  const freed = new Promise(done => { free = done; });
  window.fetch = async (...all) => {
    const answer = await plain(...all);
    if (!all[0].endsWith('/preview')) return answer;
    if (sent.push(JSON.parse(all[1].body).scene.q.shoulder) - 1 === late) await freed;
    seen += 1; return answer; };
  const slider = document.querySelector('#sliders input');
  for (const [k, angle] of [0.3, 0.6, 0.9].entries()) {
    slider.value = angle; slider.dispatchEvent(new Event('input'));
    while (sent.length <= k) await new Promise(done => setTimeout(done, 10));
    while (seen < k + (k < late)) await new Promise(done => setTimeout(done, 10)); }
  while (seen < 2) await new Promise(done => setTimeout(done, 10));
  free();
  while (seen < 3) await new Promise(done => setTimeout(done, 10));
  window.fetch = plain; window.asked = sent; })(%d), 0"""
VERIFIED = "document.getElementById('run-status').innerText === 'The error bar is there.'"


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.parametrize("late", [0, 1, 2])
def test_a_moved_slider_simulates_again_and_late_answers_replace_no_newer_ones(page: Page, late: int) -> None:
    page.open()
    page.wait_for(VERIFIED)
    page.evaluate(LATE % late)
    page.wait_for("window.asked")
    assert page.evaluate("window.asked") == [0.3, 0.6, 0.9]
    page.wait_for(VERIFIED)
    page.choose("#scrub", "0")
    assert float(page.evaluate("document.querySelector('#plots .legend .value').innerText")) == pytest.approx(0.9)
    assert page.evaluate("document.getElementById('stale').hidden")
    assert '"shoulder":0.9' in page.evaluate("decodeURIComponent(location.hash)")


@pytest.mark.slow
@pytest.mark.browser
def test_mujoco_stands_beside_it_with_its_distance(page: Page) -> None:
    pytest.importorskip("mujoco")
    page.open()
    page.wait_for(VERIFIED)
    distances = []
    for kind, name in (("mujoco", "MuJoCo"), ("coarse", "semi-implicit-euler")):
        page.choose("#beside", kind)
        page.wait_for(f"document.getElementById('compared').innerText.includes('{name}')")
        page.choose("#scrub", "0.5")
        number = "[...document.querySelectorAll('#plots figure')].find(x => x.innerText.startsWith('Distance'))"
        distances.append(float(page.evaluate(f"{number}.querySelector('.value').innerText")))
        assert page.evaluate("document.querySelectorAll('#compared li').length") == 1
    assert all(1e-5 < far < 0.1 for far in distances)  # Euler's first order, at 2 ms
    assert distances[0] == pytest.approx(distances[1], rel=0.5)


SAID = (  # to programs
    ("there is no scene 'x'", "GET /v1/scenes lists them"),
    ("there is no robot 'x'", "did you mean 'y'? (GET /v1/robots lists them and the uploaded ones)"),
    ("2 URDFs are in it, expected one", "say which: ?urdf=a.urdf"),
    ("stopped after 5 s", "patience=50, or less accuracy"),
    ("too many steps", "give no accuracy for the best effort (error.run, with the estimate 0.3), or step=0.005"),
    ("Expected `float`, got `str`", "give accuracy=4e-03, or precision='quad'"),
)


@pytest.mark.browser
def test_problems_are_told_in_the_words_of_the_page(page: Page) -> None:
    page.open()
    for what, remedy in SAID:
        text = page.evaluate(f"""import('./page/dom.js').then(dom => {{ const host = document.createElement('div');
            dom.showProblem(host, {{message: {json.dumps(what)}, remedy: {json.dumps(remedy)}, where: 'path: scene'}});
            return host.innerText; }})""")
        assert not re.search(r"/v1|GET|urdf=|\w=\w|`|error\.run|path:", text), text
        assert len(text) > 40


@pytest.mark.slow
@pytest.mark.browser
def test_a_token_is_asked_for(tmp_path: Path, browser: Browser) -> None:
    with serving(tmp_path / "data", environment={"TWOLINK_TOKEN": "let-me-in"}) as guarded:
        page = Page(browser, guarded.url)
        page.open(until="document.getElementById('token-dialog')?.open")
        page.choose("#token", "let-me-in")
        page.click("#token-form button.primary")
        page.wait_for(READY)
        page.run()
        assert page.moves()
        assert "TWOLINK_TOKEN" in page.evaluate("document.getElementById('curl').textContent")
        assert page.faults() == []


@pytest.mark.slow
@pytest.mark.browser
def test_hostile_names_stay_text(page: Page) -> None:
    name = "&lt;img src=x onerror=hacked=1&gt;"
    page.open()
    page.drop("h.urdf", pendulum(VISUAL, name=name).replace("hinge", name).replace('"arm"', f'"{name}"'))
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('<img')")
    page.run()
    assert page.evaluate("window.hacked") is None
    assert page.evaluate("document.querySelectorAll('img[src=x]').length") == 0
