"""The page at four widths, light and dark: nothing sticks out, all can be read, fingers and keys reach it."""

import pytest

from tests.parts.service.page_driver import Page
from tests.parts.service.serving import Served
from tests.show.browser import Browser

pytestmark = pytest.mark.browser
WIDTHS = ((360, 740), (768, 1024), (1400, 900), (1920, 1080))
NO_MOTION = {"name": "prefers-reduced-motion", "value": "reduce"}
TABS = ("query", "sense", "sweep", "linear", "identify", "study", "past")
SHOWN = "const shown = e => e.checkVisibility({checkOpacity: true, checkVisibilityCSS: true});"
# What reaches over the window's right edge, without what scrolls within something that does not.
STICKS_OUT = f"""(() => {{ {SHOWN}
  const scrolls = e => {{ for (let p = e.parentElement; p && p !== document.body; p = p.parentElement)
    if (['auto', 'scroll', 'hidden'].includes(getComputedStyle(p).overflowX)) return true; return false; }};
  const out = [...document.body.querySelectorAll('*')].filter(e => shown(e) && !e.closest('.skip')
    && e.getBoundingClientRect().right > innerWidth + 1 && !scrolls(e));
  const names = out.map(e => e.tagName + '#' + e.id + '.' + e.className);
  if (document.documentElement.scrollWidth > innerWidth) names.push('the page is ' +
    document.documentElement.scrollWidth + ' wide');
  return names; }})()"""
# Texts with less contrast than WCAG 2.2 asks for at level AA: 4.5, or 3 where they are large.
FAINT = f"""(() => {{ {SHOWN}
  const numbers = text => {{
    const c = document.createElement('canvas').getContext('2d', {{willReadFrequently: true}});
    c.fillStyle = text; c.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = c.getImageData(0, 0, 1, 1).data; return [r, g, b, a / 255]; }};
  const over = ([r, g, b, a], below) => [r, g, b].map((x, i) => a * x + (1 - a) * below[i]);
  const behind = e => {{ const layers = [];
    for (let p = e; p; p = p.parentElement) {{ const bg = numbers(getComputedStyle(p).backgroundColor);
      if (bg[3]) layers.push(bg); if (bg[3] === 1) break; }}
    return layers.reverse().reduce((below, layer) => over(layer, below), [255, 255, 255]); }};
  const light = rgb => rgb.map(x => x / 255).map(x => x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4)
    .reduce((sum, x, i) => sum + x * [0.2126, 0.7152, 0.0722][i], 0);
  const found = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {{
    const e = walk.currentNode.parentElement, style = getComputedStyle(e);
    if (!walk.currentNode.data.trim() || !shown(e) || e.closest('svg, .visually-hidden, .skip, option')) continue;
    if (e.closest('button, input, select')?.disabled || e.closest('label')?.querySelector('input:disabled')) continue;
    let opacity = 1; for (let p = e; p; p = p.parentElement) opacity *= Number(getComputedStyle(p).opacity);
    const back = behind(e), ink = numbers(style.color); ink[3] *= opacity;
    const [a, b] = [light(over(ink, back)), light(back)].sort((x, y) => y - x);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < (large ? 3 : 4.5)) found.push(walk.currentNode.data.trim().slice(0, 30) + ' ' + ratio.toFixed(2));
  }}
  return [...new Set(found)]; }})()"""
# Controls less than 24 px wide or high (WCAG 2.2, 2.5.8), without links in texts; of a box its label counts.
SMALL = f"""(() => {{ {SHOWN}
  return [...document.querySelectorAll('a[href], button, input, select, textarea, summary')].filter(e => {{
    const r = (e.type === 'checkbox' && e.closest('label') || e).getBoundingClientRect();
    const side = Math.min(r.width, r.height);
    return shown(e) && !e.disabled && !e.matches('.visually-hidden, .mark, p a, li a') && side < 24;
  }}).map(e => e.outerHTML.slice(0, 80)); }})()"""
# Controls that can be seen and used, each marked with a number.
CONTROLS = f"""(() => {{ {SHOWN}
  const kinds = 'a[href], button, input, select, textarea, summary, [tabindex]';
  const all = [...document.querySelectorAll(kinds)].filter(e => shown(e) && e.tabIndex >= 0 && !e.disabled);
  all.forEach((e, i) => {{ e.dataset.number = i; }}); return all.length; }})()"""


@pytest.fixture
def full(page: Page) -> Page:
    """The page with results of other settings, a comparison and a problem, and all that opens open."""
    page.open("#scene=arm-human")
    page.choose("#duration", "0.5")
    page.run()
    page.click("#play")
    page.click("#keep")
    page.wait_for("!document.getElementById('compared').hidden")
    page.choose("#add-effect", "A sine torque", stays=False)
    page.evaluate("document.querySelectorAll('#effects [role=switch]')[1].click()")
    page.evaluate("document.querySelectorAll('details').forEach(x => { x.open = true; })")
    page.wait_for("document.querySelectorAll('#effects .form').length >= 3")
    page.evaluate("document.getElementById('tab-identify').click()")
    page.evaluate("document.getElementById('identify-button').click()")
    page.wait_for("document.querySelector('#identify-problem .problem')")
    page.evaluate("document.getElementById('tab-sweep').click()")
    page.wait_for("document.getElementById('sweep-name-2').value")
    page.evaluate("document.getElementById('tab-past').click()")
    page.wait_for("document.querySelector('#past .past-title')")
    return page


@pytest.mark.slow
def test_nothing_sticks_out_and_all_text_can_be_read(full: Page) -> None:
    found: dict[str, list[str]] = {}
    for scheme in ("light", "dark"):
        feature = {"name": "prefers-color-scheme", "value": scheme}
        full.browser.call("Emulation.setEmulatedMedia", features=[feature, NO_MOTION])
        for width, height in WIDTHS:
            full.browser.resize(width, height, mobile=width < 600)
            assert full.evaluate("innerWidth") == width
            for tab in TABS:
                full.evaluate(f"document.getElementById('tab-{tab}').click()")
                for what, script in (("sticks out", STICKS_OUT), ("faint", FAINT), ("small", SMALL)):
                    if wrong := full.evaluate(script):
                        found[f"{scheme}, {width} px, {tab}, {what}"] = wrong[:5]
    assert found == {}
    full.evaluate("document.querySelector('h2').style.color = '#555'")  # so each check can fail
    full.evaluate("document.querySelector('.tagline').append(Object.assign(new Image(), {width: 3000}))")
    full.evaluate("document.querySelector('.top nav a').style.lineHeight = '18px'")
    assert any(">API<" in html for html in full.evaluate(SMALL))
    assert any("Robot" in text for text in full.evaluate(FAINT))
    assert any("IMG" in name for name in full.evaluate(STICKS_OUT))


@pytest.mark.slow
def test_the_keyboard_reaches_every_control(full: Page) -> None:
    full.browser.resize(1400, 900)
    full.evaluate("document.querySelector('#panel-sense .picker').replaceChildren()")
    full.evaluate("document.getElementById('tab-sense').click()")
    full.wait_for("document.querySelector('#panel-sense .picker input')")
    count = full.evaluate(CONTROLS)
    assert count > 60
    full.evaluate("document.activeElement.blur(); scrollTo(0, 0)")
    reached = set()
    for _ in range(2 * count):
        full.press("Tab", 9)
        number = full.evaluate("document.activeElement.dataset.number ?? ''")
        if number and number in reached:
            break
        reached.add(number)
    missed = sorted(set(map(str, range(count))) - reached, key=int)
    shown = "document.querySelector('[data-number=\"%s\"]')?.outerHTML.slice(0, 90) ?? ''"  # or drawn anew meanwhile
    assert [html for i in missed if (html := full.evaluate(shown % i))] == []


def test_a_browser_without_3d_says_so_and_does_all_else(served: Served, browser: Browser) -> None:
    """The robot's "Drawing..." stayed for ever."""
    refuse = """const get = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
          return kind.includes('webgl') ? null : get.call(this, kind, ...more); };"""
    browser.call("Page.addScriptToEvaluateOnNewDocument", source=refuse)
    page = Page(browser, served.url)
    page.open()
    page.run()
    assert "cannot be drawn in this browser" in page.text("#view-note")
    assert "≤" in page.text("#summary .good")
    assert all("Error creating WebGL context" in fault for fault in page.faults())
