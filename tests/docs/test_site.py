"""The documentation site: it builds without warnings, all of its examples run, and it is complete."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from PIL import Image
from sphinx.search.en import SearchEnglish

import twolink as tl
from tests.show.browser import Browser
from twolink.hard import all_cases

TOP = Path(__file__).parents[2]
SHOWN = ("index", "why", "gallery", "tutorials/own_urdf", "generated/effects", "generated/scenes",
         "generated/api_scenes")  # fmt: skip
DOCS = TOP / "docs"
PAGES = [page for page in DOCS.rglob("*.md") if page.parent.name not in ("generated", "operating")]
HELD = "operating.md", "architecture.md"  # the loop that the latter prints is held against the source
NOT_RUN = {"console"}  # what installs or serves; everything else is run

RUNNER = """
import atexit, json, os, re, signal, sys, time, warnings
from pathlib import Path
from IPython.core.interactiveshell import InteractiveShell
from shell_cells import STARTUP


def end_what_cells_started():
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    os.killpg(0, signal.SIGTERM)


os.setsid()
atexit.register(end_what_cells_started)

shell = InteractiveShell.instance(colors="nocolor")
folder = Path(sys.argv[1])
warnings.simplefilter("error")
done = set(re.sub(" +#.*", "", Path(sys.argv[2]).read_text("utf-8")).split("\\n"))  # run by tests/test_readme.py
for path in sys.argv[3:]:
    began = time.perf_counter()
    page = Path(path)
    place = folder / page.stem
    place.mkdir()
    os.chdir(place)
    shell.reset()
    shell.run_cell(STARTUP, store_history=False)
    text = page.read_text("utf-8")
    cells = re.findall(r"^```{code-cell}.*?\\n(.*?)^```", text, re.M | re.S)
    if page.suffix == ".ipynb":
        cells = ["".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    for cell in cells:
        code = re.sub(r"\\A(:\\w.*\\n)+", "", cell)
        if code.startswith("%%sh\\n") and set(code.strip().split("\\n")[1:]) <= done:
            continue
        outcome = shell.run_cell(code, store_history=False)
        if not outcome.success:
            sys.exit(f"{page.name} fails at:\\n{code}")
    print(f"{page.name}: {time.perf_counter() - began:.1f} s")
"""


def environment(folder: Path) -> dict[str, str]:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return {**os.environ, "PATH": path, "PYTHONPATH": os.pathsep.join([str(TOP), str(DOCS / "extensions")]),
            "IPYTHONDIR": str(folder / "ipython"), "MPLBACKEND": "agg"}  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site without running examples and scenes, as scripts/docs --quick builds it."""
    out = tmp_path_factory.mktemp("site")
    options = ["-D", "nb_execution_mode=off", "-D", "twolink_playbacks=0", "-d", str(out / "doctrees")]
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-b",
        "html",
        *options,
        str(DOCS),
        str(out / "html"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(out), timeout=300)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-6000:]
    return out / "html"


@pytest.mark.slow
def test_the_examples_run(tmp_path: Path) -> None:
    """Every cell of every page, in one process, each page in a folder of its own."""
    pages = [str(page) for page in PAGES if "{code-cell}" in page.read_text("utf-8")]
    assert len(pages) >= 8
    pages.append(str(DOCS / "tutorials" / "paper_exercise.ipynb"))
    command = [sys.executable, "-c", RUNNER, str(tmp_path), str(TOP / "README.md"), *pages]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment(tmp_path),
                          timeout=3600)  # fmt: skip
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-3000:]


def test_no_example_is_left_out() -> None:
    for page in PAGES:
        kinds = set(re.findall(r"^```(\w+)$", page.read_text("utf-8"), re.MULTILINE)) - NOT_RUN
        assert not kinds & {"python", "sh", "bash", "shell", "javascript", "js"} or page.name in HELD, page


@pytest.mark.slow
def test_the_catalogues_are_complete(site: Path) -> None:
    effects = (site / "generated/effects.html").read_text("utf-8")
    for name in dir(tl.effects):
        assert name == "Effect" or f'id="twolink.effects.{name}"' in effects, name
    for page, names in {
        "methods": [m["name"] for m in tl.methods()],
        "scenes": [s["name"] for s in tl.scenes()],
        "hard_cases": [case.name for case in all_cases()],
    }.items():
        text = (site / f"generated/{page}.html").read_text("utf-8")
        assert [name for name in names if name not in text] == []
    reference = "".join(page.read_text("utf-8") for page in (site / "generated").glob("api_*.html"))
    assert [name for name in tl.__all__ if f'id="twolink.{name}"' not in reference] == ["effects", "errors", "lagrange"]


@pytest.mark.slow
def test_the_list_for_programs_has_every_page(site: Path) -> None:
    lines = (site / "llms.txt").read_text("utf-8").splitlines()
    assert lines[0] == "# twolink"
    listed = re.findall(r"^- \[(.+?)\]\((.+?)\)", "\n".join(lines), re.MULTILINE)
    pages = {str(page.relative_to(site)) for page in site.rglob("*.html")} - {"genindex.html", "search.html"}
    assert {target for _, target in listed} >= {page for page in pages if "/" not in page or page.startswith("how/")}
    assert all((site / target).exists() for _, target in listed)


@pytest.mark.slow
def test_the_reference_says_what_docstrings_say(site: Path) -> None:
    """A property's first line is no type before a colon, and parameters that share a text have it once."""
    pages = (page.read_text("utf-8") for page in (site / "generated").glob("api_*.html"))
    text = " ".join(re.sub("<[^>]+>", "", " ".join(pages)).split())
    assert "up to which the error bar is below the accuracy asked for; None: unknown." in text
    assert "q, v (array_like or mapping of joint to array_like, optional)" in text


def test_the_gallery_has_a_page_and_a_picture_of_each_motion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DOCS / "extensions")
    gallery = importlib.import_module("gallery")
    entries = {entry.key: entry for entry in (*gallery.scene_entries(), *gallery.case_entries())}
    assert len(entries) > len(tl.scenes()) + 30
    folder = tmp_path / gallery.FOLDER
    folder.mkdir()
    for key in ("arm-swing", "case-misaligned-hinge"):  # the latter is refused
        gallery.write_entry(folder, entries[key])
    assert sorted(file.name for file in folder.iterdir()) == ["arm-swing.html", "arm-swing.png"]
    with Image.open(folder / "arm-swing.png") as image:
        assert image.size == gallery.SIZE
    site = SimpleNamespace(outdir=tmp_path)
    assert 'src="../playback/arm-swing.png"' in gallery.picture(site, "arm-swing", "An arm")
    assert gallery.picture(site, "case-misaligned-hinge", "A hinge") == ""


@pytest.mark.slow
def test_methods_have_pictures_of_what_accuracy_costs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DOCS / "extensions")
    pictures = importlib.import_module("method_pictures")
    monkeypatch.setattr(pictures, "TOLERANCES", (1e-3,))
    monkeypatch.setattr(pictures, "METHODS", ("rk45", "dop853"))
    site = SimpleNamespace(outdir=tmp_path, config=SimpleNamespace(twolink_playbacks=True))
    pictures.write_pictures(site)
    assert {"rk45", "dop853"} == {file.stem for file in (tmp_path / pictures.FOLDER).glob("*.png")}
    assert 'src="../methods/rk45.png"' in pictures.picture(site, "rk45")
    assert pictures.picture(site, "none") == ""


@pytest.mark.slow
def test_the_search_finds_a_page_for_the_words_that_people_type(site: Path) -> None:
    """As the search of the site: every word, by its stem, in the page's text or title."""
    given = (site / "searchindex.js").read_text("utf-8")
    index, english = json.loads(given[given.index("(") + 1 : -1]), SearchEnglish({})
    places = [index[part] for part in ("terms", "titleterms")]

    def pages(word: str) -> set[str]:
        found = [part.get(english.stem(word.lower()), []) for part in places]
        return {index["docnames"][i] for one in found for i in ([one] if isinstance(one, int) else one)}

    rows = re.findall(r"^\| ([^|]+) \| (\[.+) \|$", (DOCS / "find.md").read_text("utf-8"), re.MULTILINE)
    assert len(rows) > 30
    missed = {}
    for phrases, links in rows:
        named = set(re.findall(r"\]\((.+?)\.(?:md|ipynb)\)", links))
        for phrase in phrases.split(", "):
            words = [word for word in re.findall(r"\w\w+", phrase) if english.word_filter(word)]
            hits = set.intersection(*map(pages, words))
            if not named & hits:
                missed[phrase] = named, hits - {"find"}
    assert missed == {}, missed
    assert pages("flibbertigibbet") == set()


@pytest.mark.slow
def test_the_site_asks_no_other_host(site: Path) -> None:
    for page in site.rglob("*.html"):
        asked = re.findall(r'<(?:script|link|img|iframe)[^>]+(?:src|href)="(https?://[^"]+)', page.read_text("utf-8"))
        assert asked == [], page


@pytest.mark.slow
def test_pages_have_their_pictures(site: Path) -> None:
    for page in site.rglob("*.html"):
        for source in re.findall(r'<img[^>]+src="([^":]+)"', page.read_text("utf-8")):
            assert (page.parent / source).is_file(), (page, source)


@pytest.mark.slow
@pytest.mark.browser
def test_pages_fit_narrow_and_wide_screens(site: Path, browser: Browser) -> None:
    for width in (390, 1400):
        browser.resize(width, 900)
        for name in SHOWN:
            browser.open((site / f"{name}.html").as_uri())
            assert browser.evaluate("document.documentElement.scrollWidth <= innerWidth"), (name, width)
    missing = [error for error in browser.errors if "playback" not in error]  # which the quick form leaves out
    assert missing == []
