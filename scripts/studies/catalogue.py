"""Does every robot of the catalogue answer? Each falls from random starts under gravity, with damped joints.

    python -m scripts.studies.catalogue [ROBOT ...] [--duration 2] [--starts 3] [--stops] [--limit 15]

Each robot has a process and an empty kernel cache of its own, so that its first answer is as a user meets it. Its root
is free where the catalogue says so. Starts are random states within the limits of the joints. All joints are damped by
0.1 N m s/rad or N s/m; a free root is not.
--stops: with the stops of the URDF.

Columns: seconds of the import, of the scene with its robot, and of the answer; the error bar at the end, rad or m; the
method, its steps, and what was compiled; the outcome: verified, unverified, the code of an error, or slow, where the
answers took longer than PATIENCE limits each. Rows go to out/catalogue.csv or out/catalogue-stops.csv as they come.
Robots that cannot be loaded are named, and not counted. Ends 0 if each start has a verified answer within the limit.
"""

import argparse
import json
import subprocess
import time
from collections.abc import Iterator
from dataclasses import asdict, astuple, dataclass, replace

from scripts.runner import Bars, Table, new_process, study

ACCURACY = 1e-6
PATIENCE = 4  # limits that an answer may take before the process of its robot is ended


@dataclass(frozen=True)
class Row:
    """A start of a robot and what came of it; the seconds of the import are those of the first start."""

    robot: str
    start: int = 0
    nv: int = 0
    import_seconds: float = 0.0
    scene_seconds: float = 0.0
    seconds: float = 0.0
    bar: float = float("nan")
    method: str = ""
    steps: int = 0
    compiled: str = ""
    outcome: str = "slow"
    why: str = ""

    @property
    def fails(self) -> bool:
        return self.outcome != "verified"

    def answers(self, limit: float) -> bool:
        """Whether the answer is verified and came within the limit [s]."""
        return not self.fails and self.import_seconds + self.scene_seconds + self.seconds <= limit


def print_answers(name: str, starts: int, duration: float, *, stops: bool) -> None:
    """Print the rows of a robot, computed in this process, as JSON."""
    begin = time.perf_counter()
    import twolink as tl  # here, since its seconds count
    from scripts.tasks import falling
    from twolink.robots.catalogue import catalogue_entry

    row = Row(name, import_seconds=time.perf_counter() - begin)
    for start in range(starts):
        row, begin = replace(row, start=start), time.perf_counter()
        try:
            scene = falling(name, start, catalogue_entry(name).usual_root, stops=stops)
            row = replace(row, nv=scene.robot.nv, scene_seconds=time.perf_counter() - begin)
            begin = time.perf_counter()
            run = tl.simulate(scene, duration, accuracy=ACCURACY)
            said: dict[str, object] = {
                "method": run.cost.method,
                "steps": run.cost.steps,
                "compiled": run.cost.compiled,
            }
            said |= {"outcome": "unverified"} if run.error is None else {"outcome": "verified", "bar": run.error[-1]}
        except Exception as error:  # one that is not ours is a finding of its own
            said = {"outcome": getattr(error, "code", "") or type(error).__name__, "why": " ".join(str(error).split())}
        print(json.dumps(asdict(replace(row, seconds=time.perf_counter() - begin, **said))), flush=True)
        row = replace(row, import_seconds=0.0)


def rows_of(name: str, given: argparse.Namespace) -> Iterator[Row]:
    """The rows of a robot, from a process of its own with an empty kernel cache; one that is slow ends them."""
    code = (f"from scripts.studies.catalogue import print_answers\n"
            f"print_answers({name!r}, {given.starts}, {given.duration}, stops={given.stops})")  # fmt: skip
    try:
        done = new_process(code, timeout=PATIENCE * given.limit * given.starts)
        text, late = done.stdout, Row(name, outcome="crashed", why=" ".join(done.stderr.split()[-12:]))
    except subprocess.TimeoutExpired as error:
        text, late = (error.stdout or b"").decode(), Row(name)
    lines = [line for line in text.splitlines() if line.startswith("{")]
    yield from (Row(**json.loads(line)) for line in lines)
    if len(lines) < given.starts:
        yield replace(late, start=len(lines))


def names(given: argparse.Namespace) -> list[str]:
    """The robots: the chosen ones, or all that can be loaded; others are printed with the reason."""
    import twolink as tl  # in this process to list them only

    records = tl.robots().to_records() if not given.rest else []
    for record in records:
        if record["refused"]:
            print(f"refused: {record['name']}: {record['refused'][:120]}")
    return given.rest or [record["name"] for record in records if not record["refused"]]


def show(rows: list[Row], given: argparse.Namespace) -> Bars:
    """All rows, and how many answers came in time."""
    table = Table("robot <26 | start >4 | nv >4 | import >7.2f | scene >7.2f | answer >7.2f | bar >9.1e | method <13 | "
                  "steps >6 | code <6 | outcome <20")  # fmt: skip
    for row in rows:
        table.add(*astuple(row)[:-2], f"{row.outcome} {row.why[:100]}")
    late, robots = [row for row in rows if not row.answers(given.limit)], {row.robot for row in rows}
    said = (f"{len(rows) - len(late)} of {len(rows)} starts and {len(robots - {row.robot for row in late})} of "
            f"{len(robots)} robots have a verified answer within {given.limit:g} s; the slowest took "
            f"{max(row.seconds for row in rows):.1f} s")  # fmt: skip
    return [(not late, said)]


if __name__ == "__main__":
    raise SystemExit(study(__doc__, "catalogue", Row, rows_of, show, names, scenes=0, rest=(), duration=2.0, starts=3,
                           stops=False, limit=15.0))  # fmt: skip
