"""The page in a real browser: a bundled scene runs as it is opened, and problems are told in the page's words."""

import json
import re

import numpy as np
import pytest

from tests.parts.service.page_driver import Page

pytestmark = pytest.mark.browser


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
    assert min(page.colours(place=i) for i in range(4)) > 20
    page.choose("#speed", "0.1")  # so that it does not end before it is paused
    assert page.moves()
    page.click("#play")
    assert page.evaluate("document.getElementById('play').getAttribute('aria-label')") == "Play"
    assert not page.moves(seconds=1)
    page.choose("#scrub", "2.5")
    assert page.text("#clock") == "2.50 s"
    page.choose("#speed", "0.25")


def test_the_price_follows_the_accuracy(page: Page) -> None:
    page.open()
    page.choose("#accuracy", "12")
    assert page.text("#accuracy-value") == "1e-12"
    page.wait_for("document.getElementById('expected')")
    assert page.evaluate("document.getElementById('accuracy').getAttribute('aria-valuetext')") == "1e-12"


def test_the_picture_waits_for_no_other_answer(page: Page) -> None:
    page.open()
    page.wait_for("performance.getEntriesByName('first-paint').length")
    asked = [url.partition("/v1/")[2] for url in page.browser.requests]
    start = asked.index("scenes/validate")
    assert start < min(asked.index("scenes/preview"), asked.index("scenes/quantities"))
    assert not any("kinematics" in each for each in asked)  # the start came with its poses


def test_a_price_that_is_asked_for_is_not_given_up(page: Page) -> None:
    page.open()
    page.evaluate("""(() => { const plain = window.fetch; window.given_up = 0;
        window.fetch = async (url, options) => { const answer = plain(url, options);
          if (!String(url).includes('explain')) return answer;
          await new Promise(done => setTimeout(done, 1000));
          return answer.catch(failure => { window.given_up += 1; throw failure; }); }; })()""")
    for exponent in ("7", "8", "9"):
        page.choose("#accuracy", exponent)
        page.browser.evaluate("new Promise(done => setTimeout(done, 300))")
    page.wait_for("document.getElementById('expected')")
    assert page.evaluate("window.given_up") == 0


def test_a_robot_moves_on_arrival_and_its_error_bar_follows(page: Page) -> None:
    page.open(until="document.getElementById('play')?.classList.contains('playing')")
    assert page.evaluate("location.hash") in ("", "#scene=arm-swing")  # whoever gets the address sees the same
    page.wait_for(VERIFIED)
    assert page.text("#summary").count("≤") == 1
    assert page.evaluate("document.getElementById('play').classList.contains('playing')")


VERIFIED = "document.getElementById('run-status').innerText === 'The error bar is there.'"

SAID = (  # to programs
    ("there is no scene 'x'", "GET /v1/scenes lists them"),
    ("there is no robot 'x'", "did you mean 'y'? (GET /v1/robots lists them and the uploaded ones)"),
    ("2 URDFs are in it, expected one", "say which: ?urdf=a.urdf"),
    ("stopped after 5 s", "patience=50, or less accuracy"),
    ("too many steps", "give no accuracy for the best effort (error.run, with the estimate 0.3), or step=0.005"),
    ("too many steps", 'give contact="located", or step=0.005'),
    ("Expected `float`, got `str`", "give accuracy=4e-03, or precision='quad'"),
)


def test_problems_are_told_in_the_words_of_the_page(page: Page) -> None:
    page.open()
    for what, remedy in SAID:
        text = page.evaluate(f"""import('./page/dom.js').then(dom => {{ const host = document.createElement('div');
            dom.showProblem(host, {{message: {json.dumps(what)}, remedy: {json.dumps(remedy)}, where: 'path: scene'}});
            return host.innerText; }})""")
        assert not re.search(r"/v1|GET|urdf=|\w=[\w'\"]|`|error\.run|path:", text), text
        assert len(text) > 40
