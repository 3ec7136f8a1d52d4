"""Public robot files under lint: what it finds in folders of them, and how long a file takes.

python -m scripts.studies.lint FOLDER ...

URDFs, and MJCFs that are models of their own. A file "in vain" is one that lint calls an error and `load_robot` takes
for dynamics. The page docs/how/lint.md has the table of public ones.
"""

import time
from collections import Counter
from pathlib import Path

import twolink as tl
from scripts.runner import Table, options, print_bars
from twolink.errors import TwolinkError

SLOWEST = 1.0  # s a file


def robots_in(folder: Path) -> list[Path]:
    """The URDFs and MJCFs in a folder, and in those in it."""
    texts = {path: path.read_bytes() for path in folder.rglob("*.xml")}
    models = (path for path, text in texts.items() if b"<mujoco" in text and b"<mujocoinclude" not in text)
    return sorted([*folder.rglob("*.urdf"), *models])


def is_in_vain(path: Path) -> bool:
    """True for a file that loads."""
    try:
        tl.load_robot(path, mimic=True)
    except TwolinkError:
        return False
    return True


def main() -> int:
    given = options(__doc__, rest=())
    table = Table("folder <24 | files >6 | with errors >12 | in vain >8 | with warnings >14 | slowest >8.2f")
    bars, errors, most = [], Counter[str](), 0.0
    for folder in map(Path, given.rest):
        files, seconds, wrong, vain, doubtful = robots_in(folder), 0.0, 0, 0, 0
        for path in files:
            begin = time.process_time()
            found = tl.lint(path)
            seconds, levels = max(seconds, time.process_time() - begin), {one.severity for one in found.defects}
            errors.update({one.rule for one in found.of("error")})
            wrong, doubtful = wrong + ("error" in levels), doubtful + ("warning" in levels)
            if "error" in levels and is_in_vain(path):
                vain += 1
                print(f"{path}: {found.of('error')[0].message}")
        table.add(folder.name, len(files), wrong, vain, doubtful, seconds)
        most = max(most, seconds)
        bars.append((20 * vain <= len(files), f"{folder.name}: errors in vain in {vain} of {len(files)} files"))
    print("files by rules of their errors:", ", ".join(f"{rule} {count}" for rule, count in errors.most_common()))
    return not print_bars([*bars, (most <= SLOWEST, f"the slowest file: {most:.1f} s")])


if __name__ == "__main__":
    raise SystemExit(main())
