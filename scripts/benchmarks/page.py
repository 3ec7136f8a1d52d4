"""One page of results: runs the benchmarks one after the other and puts what they print on a page.

    scripts/bench [--quick] [--html out/bench.html] [--only peers,queries]

Each benchmark is a module of its own, which prints its tables. Nothing else should run on the machine meanwhile.
--quick: short runs, to see whether all is well.
"""

import os
import platform
import subprocess
import sys
import time
from html import escape
from pathlib import Path

from scripts.runner import OUT, TOP, Some, once, options
from twolink.io.files import write_atomic
from twolink.io.fingerprints import processor, versions

PACKAGES = ("twolink", "pin", "heyoka", "numpy", "scipy", "mujoco", "drake")
STYLE = Path(__file__).with_name("page.css")
QUICK = ("--quick",)
# Title, options of a full and of a short run, by module. All settings of peers take half an hour.
BENCHES: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "peers": ("Single trajectories, beside SciPy, MuJoCo and Drake", ("--quick", "--rounds", "3"), QUICK),
    "queries": ("Batches of queries, beside Pinocchio and MuJoCo", (), (*QUICK, "--rounds", "3", "--states", "20000")),
    "worlds": ("Many worlds, beside MuJoCo", (), QUICK),
    "first_answers": ("The first answer of a new scene, beside SciPy", (), QUICK),
    "effects": ("What effects cost", (), QUICK),
    "sensitivities": ("Sensitivities, beside heyoka", (), ("--runs", "3", "--no-peers")),
    "service": ("The service over HTTP", (), ("--seconds", "1", "--rounds", "1", "--requests", "5000")),
}


def section(name: str, quick: bool) -> str:
    """Run a benchmark. Returns its part of the page."""
    title, full, short = BENCHES[name]
    command = [sys.executable, "-m", f"scripts.benchmarks.{name}", *(short if quick else full)]
    seconds, done = once(lambda: subprocess.run(command, cwd=TOP, capture_output=True, text=True))
    print(f"{name}: {seconds:.0f} s{', failed' * bool(done.returncode)}", flush=True)
    failed = '<p class="failed">It ended with an error, or a bar is missed.</p>' if done.returncode else ""
    text = f"{done.stdout}\n{done.stderr[-2000:] if done.returncode else ''}".strip()
    return f'<h2 id="{name}">{escape(title)}</h2>{failed}<pre>{escape(text)}</pre>'


def machine() -> str:
    """The processor, how many of it there are, and the versions of the packages that are there."""
    found = ", ".join(f"{name} {version}" for name, version in versions(PACKAGES).items() if version)
    kind = processor() or platform.machine()
    return f"{kind}, {os.cpu_count()} of them. Python {platform.python_version()}, {found}"


def main() -> None:
    given = options(__doc__, html=OUT / "bench.html", quick=False, only=Some(BENCHES))
    parts = [section(name, given.quick) for name in BENCHES if name in given.only]
    links = " ".join(f'<a href="#{name}">{escape(BENCHES[name][0].split(",")[0])}</a>' for name in given.only)
    kind = "Short runs. " if given.quick else ""
    page = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>twolink: measurements</title><style>{STYLE.read_text('utf-8')}</style><h1>twolink: measurements</h1>"
        f"<p>{kind}{time.strftime('%Y-%m-%d %H:%M')}. {escape(machine())}.</p><nav>{links}</nav>{''.join(parts)}</html>"
    )
    print(f"wrote {write_atomic(given.html, lambda file: file.write(page.encode()))}")


if __name__ == "__main__":
    main()
