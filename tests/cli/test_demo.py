"""`twolink demo`: from the check of the equations to a page that plays the arm."""

import re
from pathlib import Path

from tests.command import call


def test_the_demo_ends_in_a_page_and_its_bars_are_below_what_was_asked_for(tmp_path: Path) -> None:
    page = tmp_path / "demo.html"
    said = call("demo", "--html", str(page)).stdout
    assert "errs in C21 and C22" in said
    bars = re.findall(r"asked for (\S+) rad: error at most (\S+) rad", said)
    assert [float(asked) for asked, _ in bars] == [1e-3, 1e-6, 1e-9, 1e-12]
    assert all(float(bar) <= float(asked) for asked, bar in bars)
    assert f"wrote {page}" in said
    assert page.stat().st_size > 100_000
