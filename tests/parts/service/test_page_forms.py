"""The page's forms, which are made from the schemas of scenes and of requests: one control for each kind of value."""

import json
from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.page_driver import Page
from twolink.parts.service.work.requests import OPERATIONS

pytestmark = [pytest.mark.browser, pytest.mark.slow]
FORM = """(async () => {
  const { fields } = await import('/page/form.js');
  const defs = (await (await fetch('/v1/scene-schema')).json()).$defs;
  const names = {defs, joints: ['a', 'b'], coordinates: ['a', 'b'], links: ['one', 'two'],
    constants: {}, units: {a: 'rad', b: 'm'}};
  document.getElementById('trial')?.remove();
  document.body.insertAdjacentHTML('beforeend', '<div id="trial"></div>');
  window.made = %s;
  document.getElementById('trial').append(fields(defs[%s], window.made, to => (window.made = to), names, 'It'));
  return [...document.querySelectorAll('#trial .part-name')].map(x => x.innerText);
})()"""
RAW = """(async () => {
  const { fields, initial } = await import('/page/form.js');
  const defs = (await (await fetch('/v1/scene-schema')).json()).$defs;
  const names = {defs, joints: ['a'], coordinates: ['a'], links: ['one', 'two'], constants: {}};
  const effects = Object.entries(defs).filter(([, part]) => part.properties?.type?.enum?.length === 1);
  return effects.flatMap(([name, schema]) => {
    const form = fields(schema, initial(schema, names), () => {}, names, name);
    return [...form.querySelectorAll('[data-json]')].map(x => x.ariaLabel);
  });
})()"""


def made(page: Page, effect: str, value: object) -> list[str]:
    """The names of the fields of a new form of an effect; `window.made` is its value."""
    return list(page.evaluate(FORM % (json.dumps(value), json.dumps(effect))))


def test_no_field_of_an_effect_is_typed_as_json(page: Page) -> None:
    page.open()
    assert page.evaluate(RAW) == []


def test_a_field_has_the_control_of_its_declared_type(page: Page) -> None:
    page.open()
    assert "function" not in made(page, "Watch", {"type": "watch", "name": "w", "stop": False})  # from Python only
    page.evaluate("document.querySelector(\"[aria-label='It stop']\").click()")
    page.choose("[aria-label='It direction']", "-1")
    assert page.evaluate("window.made") == {"type": "watch", "name": "w", "stop": True, "direction": -1}

    made(page, "JointPD", {"type": "joint-pd", "target": {"a": 0.5, "b": 0}, "kp": {"a": 1, "b": 1}, "kd": {"b": 2}})
    page.choose("[aria-label='It target a']", "30 deg")
    assert page.evaluate("window.made")["target"] == {"a": "30 deg", "b": 0}
    for wrong in ("30 mm", "thirty", ""):  # no units of an angle, no number
        page.choose("[aria-label='It target a']", wrong)
        assert page.evaluate("document.querySelector(\"[aria-label='It target a']\").ariaInvalid") == "true"
    page.choose("[aria-label='It target b']", "5 mm")
    assert page.evaluate("window.made")["target"] == {"a": "30 deg", "b": "5 mm"}
    page.evaluate("document.querySelector('[aria-label=\"Leave b out of It target\"]').click()")
    assert page.evaluate("[window.made.kp, window.made.kd]") == [{"a": 1}, {}]  # of the joints with a target
    page.choose("[aria-label='Add to It target']", "b", stays=False)
    assert page.evaluate("[window.made.kp, window.made.kd]") == [{"a": 1, "b": 0}, {}]

    made(page, "PlaneContact", {"type": "plane-contact", "frame": "two"})
    assert "at least 0, at most 1" in page.text("#trial")
    page.choose("[aria-label='It restitution']", "1.5")
    assert "restitution" not in page.evaluate("window.made")
    page.choose("[aria-label='It point y']", "0.2")
    page.choose("[aria-label='It frame']", "one")
    assert page.evaluate("window.made") == {"type": "plane-contact", "frame": "one", "point": [0, 0.2, 0]}

    made(page, "Encoder", {"type": "encoder", "joints": ["a"]})
    page.evaluate("document.querySelector('[aria-label=\"Add to It joints\"]').click()")
    page.choose("[aria-label='It joints 2']", "b")
    page.choose("[aria-label='It seed']", "1.5")  # an integer
    assert page.evaluate("window.made") == {"type": "encoder", "joints": ["a", "b"]}


def test_every_operation_has_a_form_and_its_answer_is_shown(page: Page, tmp_path: Path) -> None:
    page.open("#robot=two_link")
    page.click("#tab-operation")
    page.wait_for("document.getElementById('operation-name').options.length > 1")
    names = page.evaluate("[...document.getElementById('operation-name').options].map(x => x.value)")
    assert set(names) == set(OPERATIONS)
    page.choose("#operation-name", "trapezoidal_motion")
    for name, value in (("q", "0 0"), ("to", "1 0.5"), ("acceleration", "2 2")):
        page.choose(f"[aria-label='trapezoidal motion {name}: kind']", "1")
        page.choose(f"[aria-label='trapezoidal motion {name}']", value)
    page.click("#operation-button")
    page.wait_for("document.querySelector('#operation-result table')")
    motion = tl.trapezoidal_motion(tl.load_robot("two_link"), [0, 0], [1, 0.5], acceleration=[2, 2])
    assert f"{motion.t[-1]:.4g}"[:5] in page.text("#operation-result")

    page.choose("#operation-name", "judge")
    run = tl.simulate(tl.scene_of(tl.load_robot("two_link")), 0.5, samples_per_second=50)
    columns = "t,q.shoulder,q.elbow,v.shoulder,v.elbow"
    np.savetxt(tmp_path / "log.csv", np.column_stack([run.t, run.q, run.v]), "%.17g", ",", header=columns, comments="")
    page.evaluate("document.querySelector(\"[aria-label='judge trajectory']\").id = 'log'")
    page.upload(tmp_path / "log.csv", "log")
    page.choose("[aria-label='judge accuracy']", "1e-7")
    page.click("#operation-button")
    page.wait_for("document.querySelector('#operation-result table')")
    assert "right" in page.text("#operation-result")
