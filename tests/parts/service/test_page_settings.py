"""The page's settings: forms of effects, start velocities, the address, runs that are compared, and the lists."""

import json
from pathlib import Path
from urllib.parse import unquote

import pytest

from tests.parts.service.page_driver import READY, Page
from tests.parts.service.serving import pendulum, zipped

pytestmark = [pytest.mark.browser, pytest.mark.slow]
SCENE = "JSON.parse(document.getElementById('scene-json').value)"
REFUSED = """(async () => {
  const { templates } = await import('/page/templates.js');
  const post = (path, body) => fetch(path, {method: 'POST', body: JSON.stringify(body),
    headers: {'Content-Type': 'application/json'}}).then(async x => [x.ok, await x.json()]);
  const refused = [], tried = new Set();
  for (const id of %s) {
    const robot = await fetch(`/v1/robots/${id}`).then(x => x.json());
    const [, rows] = await post('/v1/scenes/quantities', {scene: {robot: id}});
    const constants = Object.fromEntries(rows.filter(x => x.name.endsWith('.mass')).map(x => [x.name, x.value]));
    const [, {frames, poses}] = await post(`/v1/robots/${id}/kinematics`, {q: robot.neutral});
    const place = poses[frames.indexOf(robot.links.filter(x => !robot.fixed_links.includes(x)).at(-1))];
    for (const group of Object.values(templates({robot, q: robot.neutral, place, constants})))
      for (const [name, effect] of Object.entries(group)) {
        const [ok, answer] = await post('/v1/scenes/validate', {scene: {robot: id, effects: [effect]}});
        tried.add(effect.type);
        if (effect.of) tried.add(effect.of.type);
        if (!ok) refused.push(`${id}, ${name}: ${answer.where}: ${answer.detail}`);
      }
  }
  return [refused, [...tried]];
})()"""


def settled(page: Page) -> None:
    """Wait until the service has counted the scene."""
    page.wait_for("document.getElementById('expected') || document.querySelector('#scene-problem .problem')")


def legend(page: Page) -> list[str]:
    """The names of the curves of q."""
    names = "[...document.querySelector('#plots .legend').querySelectorAll('.name')].map(x => x.textContent)"
    return list(page.evaluate(names))


def test_every_effect_that_the_page_offers_is_taken_by_the_service(page: Page) -> None:
    page.open()
    refused, kinds = page.evaluate(REFUSED % json.dumps(["two_link", "bouncing_ball"]))
    assert refused == []
    assert {"contact", "point-loop", "hinge-loop", "weld-loop", "state-feedback", "engage"} <= set(kinds)
    assert len(kinds) >= 23


def test_the_values_of_an_effect_are_edited_in_a_form(page: Page) -> None:
    page.open("#scene=arm-human")
    for i in (0, 1):
        page.evaluate(f"document.querySelectorAll('#effects .values')[{i}].open = true")
    page.wait_for("document.querySelectorAll('#effects .form').length === 2")
    assert "m[gravity.z]" not in page.text("#effects")
    page.choose("[aria-label='Gravity field z']", "-1.62")
    page.choose("[aria-label='Joint damping damping elbow']", "0.7")
    assert page.evaluate(SCENE)["effects"] == [
        {"type": "gravity", "field": [0, 0, -1.62]},
        {"type": "joint-damping", "damping": {"shoulder": 0.3, "elbow": 0.7}},
    ]
    page.choose("[aria-label='Joint damping damping shoulder, slider']", "0.45")
    assert page.evaluate(SCENE)["effects"][1]["damping"]["shoulder"] == 0.45
    page.choose("[aria-label='Joint damping damping elbow']", "-1")
    assert page.evaluate("document.querySelector(':focus-visible, [aria-invalid=true]').ariaLabel").endswith("elbow")
    assert page.evaluate(SCENE)["effects"][1]["damping"]["elbow"] == 0.7  # what is out of bounds is not taken
    page.evaluate("document.querySelector('[aria-label=\"Leave shoulder out of Joint damping damping\"]').click()")
    assert page.evaluate(SCENE)["effects"][1]["damping"] == {"elbow": 0.7}
    page.choose("#add-effect", "A sine torque", stays=False)
    page.choose("[aria-label='Torque inputs shoulder amplitude']", "5")
    page.choose("[aria-label='Torque inputs shoulder: kind']", "0")  # a number in place of the sine
    page.choose("[aria-label='Torque inputs shoulder']", "1.5")
    assert page.evaluate(SCENE)["effects"][2] == {"type": "torque", "inputs": {"shoulder": 1.5}}
    settled(page)
    assert page.text("#scene-problem") == ""


def test_masses_and_start_velocities_are_edited_and_decide_the_run(page: Page) -> None:
    page.open("#robot=two_link")
    page.evaluate("document.getElementById('speeds-details').open = true")
    page.choose("#speeds input", "2")
    page.choose("#add-effect", "Other masses", stays=False)
    page.wait_for("document.querySelector('[aria-label^=\"Constants values\"]')")
    name = page.evaluate("document.querySelector('input[aria-label^=\"Constants values\"]').ariaLabel")
    page.choose(f"[aria-label='{name}']", "3.5")
    scene = page.evaluate(SCENE)
    assert scene["v"] == {"shoulder": 2}
    assert 3.5 in scene["effects"][-1]["values"].values()
    page.run()
    page.choose("#scrub", "0")
    assert float(page.evaluate("document.querySelectorAll('#plots .legend .value')[2].innerText")) == pytest.approx(2)
    page.click("#start-reset")
    page.wait_for("document.querySelector('#speeds input').value === '0'")
    assert "v" not in page.evaluate(SCENE)


def test_the_address_holds_scene_changes_and_run(page: Page) -> None:
    page.open("#scene=arm-human")
    page.choose("#duration", "1.5")
    page.choose("#accuracy", "4")
    page.evaluate("document.querySelectorAll('#effects [role=switch]')[1].click()")
    page.run()
    shown, scene = page.evaluate("location.hash"), page.evaluate(SCENE)
    assert "run=simulation-" in shown
    page.open(shown)  # sent to somebody, or loaded again
    page.wait_for("!document.getElementById('result').hidden")
    assert page.evaluate(SCENE) == scene
    assert page.text("#accuracy-value") == "1e-4"
    switches = page.evaluate("[...document.querySelectorAll('#effects [role=switch]')].map(x => x.checked)")
    assert switches == [True, False]
    assert page.evaluate("document.getElementById('stale').hidden")
    page.evaluate("window.loadedOnce = true")
    page.choose("#scene-select", "arm-swing")
    page.wait_for("location.hash === '#scene=arm-swing'")
    page.evaluate("history.back()")
    page.wait_for("location.hash.startsWith('#scene=arm-human') && !document.getElementById('result').hidden && "
                  "document.getElementById('scene-select').value === 'arm-human'")  # fmt: skip
    assert page.evaluate("window.loadedOnce")  # the choice was a step of this page's history
    assert page.evaluate(SCENE) == scene


def test_an_address_that_names_nothing_says_so(page: Page) -> None:
    page.open("#scene=nonsense")
    assert "There is no scene" in page.text("#robot-problem")
    assert page.text("#robot-facts").startswith("two_link")
    page.open("#scene=arm-swing&run=simulation-0123456789abcdef0123")
    assert "not kept here" in page.text("#run-status")


def test_results_of_other_settings_say_so(page: Page) -> None:
    page.open("#scene=arm-human")
    page.choose("#duration", "1")
    page.run()
    assert "Torque N m" in page.text("#plots")  # of its damping
    assert page.evaluate("document.getElementById('stale').hidden")
    page.choose("#duration", "2")
    assert "other duration" in page.text("#stale")
    page.choose("#accuracy", "5")
    assert "duration, accuracy" in page.text("#stale")
    page.click("#stale-back")
    page.wait_for("document.getElementById('duration').value === '1' && document.getElementById('stale').hidden "
                  "&& !document.getElementById('result').hidden")  # fmt: skip
    assert page.text("#accuracy-value") == "1e-6"


def test_runs_are_compared(page: Page) -> None:
    page.open("#scene=arm-human")
    page.choose("#duration", "1")
    page.run()
    page.click("#keep")
    page.wait_for("!document.getElementById('compared').hidden")
    page.evaluate("document.querySelectorAll('#effects [role=switch]')[1].click()")
    page.click("#run-button")
    page.wait_for("document.getElementById('compared').innerText.includes('other effects')")
    assert "q differs by up to" in page.text("#compared")
    both = page.colours()
    page.open(page.evaluate("location.hash"))
    page.wait_for("document.getElementById('compared').innerText.includes('other effects')")
    page.click("#compared button")
    page.wait_for("document.getElementById('compared').hidden")
    assert page.colours() < both
    assert "compare=" not in page.evaluate("location.hash")


def test_a_run_goes_on_after_a_reload(page: Page) -> None:
    page.open("#scene=arm-human")
    page.choose("#method", "midpoint")
    page.choose("#duration", "1000")
    page.choose("#accuracy", "5")  # 20 s; at 1e-7 it needs too many steps, and ends before the page is loaded again
    page.click("#run-button")
    page.wait_for("location.hash.includes('run=')")
    page.open(page.evaluate("location.hash"), until="document.documentElement?.dataset.ready")
    page.wait_for("!document.getElementById('cancel-button').hidden")
    assert page.evaluate("document.getElementById('duration').value") == "1000"
    page.wait_for("/Running|Queued/.test(document.getElementById('run-status').innerText)")
    page.evaluate("document.getElementById('cancel-button').click()")
    page.wait_for("document.getElementById('cancel-button').hidden")


def test_one_robot_of_a_zip_is_chosen(page: Page, tmp_path: Path) -> None:
    bad = pendulum(name="bad").replace('mass value="2"', 'mass value="-1"')
    (tmp_path / "two.zip").write_bytes(zipped({"a/one.urdf": pendulum(name="one"), "b/two.urdf": bad}))
    page.open()
    page.upload(tmp_path / "two.zip")
    page.wait_for("document.querySelectorAll('#robot-problem .choices button').length === 2")
    page.evaluate("document.querySelector('#robot-problem .choices button:last-child').click()")
    page.wait_for("document.getElementById('robot-problem').innerText.includes('negative')")
    assert "b/two.urdf:3" in page.text("#robot-problem")  # the file, not "URDF text"
    page.upload(tmp_path / "two.zip")
    page.wait_for("document.querySelectorAll('#robot-problem .choices button').length === 2")
    page.click("#robot-problem .choices button")
    page.wait_for("document.getElementById('robot-facts').innerText.startsWith('one')")


def test_long_lists_are_searched(page: Page) -> None:
    page.open()
    page.evaluate("document.getElementById('robot-search').focus()")
    for letter in "bouncing":
        page.press(letter, ord(letter.upper()), letter)
    names = page.evaluate("[...document.getElementById('robot-select').options].map(x => x.textContent)")
    assert names
    assert all("bouncing" in name for name in names)
    page.press("Enter", 13, "\r")
    page.wait_for(f"document.getElementById('robot-facts').innerText.startsWith({json.dumps(names[0])}) && {READY}")
    assert page.evaluate("document.getElementById('robot-select').options.length") > 20


def test_the_curves_of_a_robot_with_many_joints_are_chosen(page: Page) -> None:
    page.open("#robot=panda")
    page.choose("#duration", "0.1")
    page.choose("#accuracy", "3")
    page.run()
    assert len(legend(page)) == 8
    page.evaluate("document.getElementById('curves').open = true")
    page.evaluate("[...document.querySelectorAll('#curves button')].find(x => x.innerText === 'None').click()")
    assert legend(page) == []
    page.evaluate("[...document.querySelectorAll('#curves label')].find(x => /joint7/.test(x.innerText)).click()")
    assert legend(page) == ["panda_joint7"]
    assert unquote(page.evaluate("document.querySelector('#curves summary').innerText")) == "Curves: 1 of 9 joints"
