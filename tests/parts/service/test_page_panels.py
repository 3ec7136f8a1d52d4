"""The page's panels: sensitivities, linearization, identification and sweeps, each with its figure."""

from pathlib import Path

import numpy as np
import pytest

import twolink as tl
from tests.parts.service.page_driver import Page
from tests.parts.service.test_client import measured
from twolink.scenes.parameters import parameters_of

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def test_a_tube_shows_what_one_per_cent_of_a_mass_does(page: Page) -> None:
    page.open("#scene=arm-swing")
    page.choose("#duration", "0.5")
    page.click("#tab-sense")
    page.wait_for("document.querySelectorAll('#panel-sense .picker input:checked').length === 2")
    page.click("#sense-button")
    page.wait_for("document.querySelector('#sense-result table')")
    names = page.evaluate("[...document.getElementById('sense-name').options].map(x => x.value)")
    scene = tl.load_scene("arm-swing")
    found = tl.sensitivities(scene, wrt=names, duration=0.5)
    shown = page.evaluate("[...document.querySelectorAll('#sense-result tbody tr')].map(x => x.children[3].innerText)")
    for name, text in zip(names, shown, strict=True):
        assert float(text.replace("−", "-")) == pytest.approx(np.abs(found.q[name]).max(), rel=2e-3)
    assert page.colours("#sense-result canvas") > 20
    mass = next(name for name in names if name.endswith(".mass"))
    row = f"[...document.querySelectorAll('#sense-result tbody tr')].find(x => x.innerText.startsWith('{mass}'))"
    change, moved = page.evaluate(f"[...{row}.children].slice(1, 3).map(x => x.innerText)")
    assert change == f"± 1 % of {mass}"
    least = 0.01 * np.abs(found.q[mass]).max() * parameters_of(scene)[mass].nominal
    assert float(moved) == pytest.approx(least, rel=1e-2)


def test_eigenvalues_tell_the_raised_arm_from_the_hanging_one(page: Page) -> None:
    page.open("#robot=two_link")
    page.click("#tab-linear")
    page.choose("#sliders .slider:nth-child(2) input[type=number]", "0")
    verdicts = []
    for angle in ("1.5707963267948966", "-1.5707963267948966"):
        page.choose("#sliders input[type=number]", angle)
        page.evaluate("document.getElementById('linear-result').replaceChildren()")
        page.click("#linear-button")
        page.wait_for("document.getElementById('linear-verdict')")
        verdicts.append(page.text("#linear-verdict"))
    assert "An equilibrium: saddle" in verdicts[0]
    assert "saddle" not in verdicts[1]
    assert page.evaluate("document.querySelectorAll('#linear-result circle').length") == 4


def test_parameters_are_identified_from_a_file(page: Page, tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(measured(tl.load_robot("two_link"), 200, 1e-2))
    page.open("#robot=two_link")
    page.click("#tab-identify")
    page.click("#identify-button")
    page.wait_for("document.querySelector('#identify-problem .problem')")
    page.upload(tmp_path / "m.csv", "identify-file")
    page.click("#identify-button")
    page.wait_for("document.getElementById('identify-verdict')")
    found = page.evaluate("document.querySelectorAll('#identify-result tbody tr').length")
    assert page.text("#identify-verdict").startswith(f"{found} found from 200 samples")
    assert "cannot be told" in page.text("#identify-result details").lower()
    assert page.colours("#identify-result canvas") > 20


def test_a_sweep_fills_its_map_marks_what_failed_and_a_cell_is_seen_to_move(page: Page) -> None:
    page.open("#scene=arm-swing")
    page.click("#tab-sweep")
    page.wait_for("document.getElementById('sweep-name-2').value === 'q.elbow'")
    for number in (1, 2):
        page.choose(f"#panel-sweep fieldset:nth-child({number}) .field:nth-child(3) input", "36")
    page.evaluate("""new MutationObserver(() => (window.seen ??= new Set()).add(
        document.querySelector('#sweep-verdict b')?.textContent)).observe(
        document.getElementById('panel-sweep'), {subtree: true, childList: true})""")
    page.click("#sweep-button")
    page.wait_for("document.querySelector('#sweep-result .downloads')")
    seen = page.evaluate("[...window.seen].filter(Boolean)")
    assert len(seen) > 1, seen  # it was drawn before all was done
    assert "over q.shoulder and q.elbow" in page.evaluate("document.querySelector('.heatmap').ariaLabel")
    assert "of 1296 runs are as accurate as asked for" in page.text("#sweep-verdict")
    assert "error bar above the accuracy" in page.text("#sweep-result .signs")  # some are chaotic
    assert page.colours("#sweep-result .heatmap") > 20
    page.evaluate("document.querySelector('#sweep-result .heatmap').focus()")
    page.press("ArrowRight", 39)
    page.press("Enter", 13, "\r")
    page.wait_for("JSON.parse(document.getElementById('scene-json').value).q.elbow === -0.5")
    page.wait_for("!document.getElementById('result').hidden && !document.getElementById('playback').hidden")
    start = page.evaluate("JSON.parse(document.getElementById('scene-json').value).q")
    assert start == {"shoulder": pytest.approx(-0.5 + 1 / 35), "elbow": -0.5}
    page.choose("#sweep-name-1", "forearm.mass")
    for place, value in (("1", "-1"), ("2", "1"), ("3", "4")):
        page.choose(f"#panel-sweep fieldset:nth-child(1) .field:nth-child({place}) input", value)
    page.choose("#panel-sweep fieldset:nth-child(2) .field:nth-child(3) input", "3")
    page.click("#sweep-button")
    page.wait_for("document.querySelector('#sweep-result .signs')?.innerText.includes('failed: 6')")
    page.evaluate("document.querySelector('#sweep-result .heatmap').focus()")
    page.press("ArrowUp", 38)
    assert "-1" in page.text("#sweep-result .facts")  # the reason of a failed run
    page.choose("#sweep-name-2", "")  # over one quantity: a curve
    page.click("#sweep-button")
    page.wait_for("document.querySelector('#sweep-result .plot')")
    assert "failed: 2" in page.text("#sweep-result .signs")
