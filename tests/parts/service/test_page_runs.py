"""Runs on the page: plots, effects, events, problems, cancelling, studies, other programs, keys and small screens."""

import json
import re
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

import twolink as tl
from tests.parts.service.page_driver import READY, Page
from tests.parts.service.serving import serving
from tests.parts.service.test_page import VERIFIED
from tests.show.browser import Browser

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def test_every_control_has_a_name(page: Page) -> None:
    page.open()
    page.run()
    nodes = page.browser.call("Accessibility.getFullAXTree")["nodes"]
    kinds = {"button", "combobox", "textbox", "slider", "spinbutton", "switch", "checkbox", "tab", "link", "image"}
    named = [(node["role"]["value"], node.get("name", {}).get("value", "")) for node in nodes if not node["ignored"]]
    assert [node for node in named if node[0] in kinds and not node[1].strip()] == []
    assert len([node for node in named if node[0] == "image"]) >= 5  # the robot and four plots say what they show
    assert page.evaluate("document.querySelectorAll('h1').length") == 1


def test_a_scene_has_its_objects(page: Page) -> None:
    page.open("#scene=arm-pushes-box")
    assert page.text("#scene-problem") == ""
    starts = "[...document.querySelectorAll('#sliders input[type=number]')].map(x => [x.ariaLabel, Number(x.value)])"
    shown = {name.split(",")[0]: value for name, value in page.evaluate(starts)}  # in q the box is the first
    assert (shown["shoulder"], shown["elbow"], shown["box x"]) == (1.2, -2.4, 0.31)
    page.choose("[aria-label='box y, exactly, m']", "0.001")
    assert page.evaluate("JSON.parse(document.getElementById('scene-json').value).q.box[1]") == 0.001
    page.choose("[aria-label='box y, exactly, m']", "0")
    page.choose("#duration", "0.2")
    page.run()
    assert page.text("#stale-what") == ""
    assert {"shoulder", "elbow", "box x"} <= set(page.text("#plots").split("\n"))
    job = page.evaluate("location.hash.match(/run=([^&]+)/)[1]")
    end = httpx.get(f"{page.url}/v1/simulations/{job}", trust_env=False).json()["result"]["q"]
    run = tl.simulate(tl.load_scene("arm-pushes-box"), 0.2)
    np.testing.assert_allclose(end, run.q[-1], atol=1e-5)


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
    job = page.evaluate("location.hash.match(/run=([^&]+)/)[1]")
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
    whole = page.evaluate("document.querySelectorAll('#plots canvas')[1].toDataURL()")
    drag: dict[str, Any] = {"button": "left", "buttons": 1}
    page.mouse("mousePressed", left + width * 0.3, middle)
    for part in (0.35, 0.45):
        page.browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=left + width * part, y=middle, **drag)
    page.mouse("mouseReleased", left + width * 0.45, middle)
    zoomed = page.evaluate("document.querySelectorAll('#plots canvas')[1].toDataURL()")
    assert zoomed != whole  # all plots share the time that is shown
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


def test_events_are_listed_and_lead_there(page: Page) -> None:
    page.open("#scene=bouncing-ball")
    page.run()
    assert "events" in page.text("#events h3")
    assert "impact" in page.text("#events")
    page.click("#events button")
    assert page.text("#clock").startswith("0.45")


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


def test_the_accuracy_study_is_drawn(page: Page) -> None:
    page.open()
    page.click("#tab-study")
    page.choose("#study-duration", "0.5")
    page.wait_for("document.querySelector('#study-methods input[value=dop853]')")
    for name in ("rk4", "taylor"):
        page.evaluate(f"document.querySelector('#study-methods [value={name}]').click()")
    page.evaluate("document.getElementById('study-settings').open = true")
    page.wait_for("document.querySelector(\"[aria-label='Study tolerances']\")")
    page.choose("[aria-label='Study tolerances']", "1e-3 1e-6")
    page.choose("[aria-label='Study repeats']", "2")
    page.click("#study-button")
    page.wait_for("document.querySelector('#study-result img')?.naturalWidth > 0")
    job = page.evaluate("fetch('/v1/studies').then(x => x.json()).then(x => x[0].request)")
    assert (job["methods"], job["tolerances"], job["repeats"]) == (["rk45", "dop853"], [1e-3, 1e-6], 2)
    assert "dop853" in page.text("#study-result table")


def test_earlier_runs_are_shown_again(page: Page) -> None:
    page.open("#scene=arm-human")
    page.run()
    page.open("#scene=arm-swing")
    page.click("#tab-past")
    page.wait_for("document.querySelector('#past .past-title')")
    page.evaluate("[...document.querySelectorAll('#past li')].find(x => x.innerText.includes('human arm'))"
                  ".querySelector('button').click()")  # fmt: skip
    page.wait_for("document.getElementById('results-title').innerText.includes('human arm')")


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


def test_the_page_is_dark_when_the_system_is(page: Page) -> None:
    dark = {"name": "prefers-color-scheme", "value": "dark"}
    page.browser.call("Emulation.setEmulatedMedia", features=[dark])
    page.open()
    assert page.browser.screenshot().mean() < 80
    assert page.robot().mean() < 100


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
