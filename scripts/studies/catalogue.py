"""Does every robot of the catalogue answer? Each falls from random starts under gravity, with damped joints.

    python scripts/honest_catalogue.py [ROBOT ...] [--duration 2] [--starts 3] [--stops] [--limit 15]

Each robot has a process and an empty kernel cache of its own, so that its first answer is as a user meets it. Its root
is free where the catalogue says so. Starts are random states within the limits of the joints. All joints are damped by
0.1 N m s/rad or N s/m; a free root is not.
--stops: with the stops of the URDF.

Columns: seconds of the import, of the scene with its robot, and of the answer; the error bar at the end, rad or m; the
method, its steps, and what was compiled; the outcome: verified, unverified, the code of an error, or slow, where the
answers took longer than PATIENCE limits each. Rows go to out/honest_catalogue.csv or out/honest_catalogue-stops.csv as
they come. Robots that cannot be loaded are named, and not counted. Ends 0 if each start has a verified answer within
the limit.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

OUT = Path(__file__).parents[1] / "out"
ACCURACY, DAMPING = 1e-6, 0.1
PATIENCE = 4  # limits that an answer may take before the process of its robot is ended
COLUMNS = "robot", "start", "nv", "import", "scene", "answer", "bar", "method", "steps", "code", "outcome"
LINE = "{:<27}{:>5}{:>5}{:>8}{:>8}{:>8}{:>10}  {:<13}{:>7}  {:<6}  {}"


@dataclass(frozen=True)
class Row:
    """A start of a robot and what came of it; the seconds of the import are those of the first start."""

    robot: str
    start: int
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

    def answers(self, limit: float) -> bool:
        """Whether the answer is verified and came within the limit [s]."""
        return self.outcome == "verified" and self.import_seconds + self.scene_seconds + self.seconds <= limit

    def __str__(self) -> str:
        numbers = (f"{s:.2f}" for s in (self.import_seconds, self.scene_seconds, self.seconds))
        return LINE.format(self.robot, self.start, self.nv, *numbers, f"{self.bar:.1e}", self.method, self.steps,
                           self.compiled, f"{self.outcome} {self.why[:100]}")  # fmt: skip


def answers(name: str, starts: int, duration: float, *, stops: bool) -> Iterator[Row]:
    """The rows of a robot, computed in this process."""
    begin = time.perf_counter()
    import twolink as tl  # here, since its seconds count
    from twolink.robots.catalogue import catalogue_entry

    row = Row(name, 0, import_seconds=time.perf_counter() - begin)
    root = catalogue_entry(name).usual_root
    for start in range(starts):
        row, begin = replace(row, start=start), time.perf_counter()
        try:
            robot = tl.load_robot(name, root=root)
            effects = [tl.effects.Gravity()]
            damped = {joint.name: DAMPING for joint in robot.joints if joint.kind != "free-flyer"}
            if damped:
                effects.append(tl.effects.JointDamping(damped))
            if stops and tl.effects.JointStops().modes(robot):
                effects.append(tl.effects.JointStops())
            q, v = robot.random_state(1, seed=start)
            scene = tl.Scene(robot, q[0], v[0], effects=effects)
            row = replace(row, nv=robot.nv, scene_seconds=time.perf_counter() - begin)
            begin = time.perf_counter()
            run = tl.simulate(scene, duration, ACCURACY)
        except Exception as error:  # one that is not ours is a finding of its own
            outcome = getattr(error, "code", "") or type(error).__name__
            yield replace(row, seconds=time.perf_counter() - begin, outcome=outcome, why=" ".join(str(error).split()))
        else:
            verified = run.error is not None
            yield replace(row, seconds=time.perf_counter() - begin, bar=float(run.error[-1]) if verified else row.bar,
                          method=run.cost.method, steps=run.cost.steps, compiled=run.cost.compiled,
                          outcome="verified" if verified else "unverified")  # fmt: skip
        row = replace(row, import_seconds=0.0)


def rows_of(name: str, options: argparse.Namespace) -> list[Row]:
    """The rows of a robot, from a process of its own with an empty kernel cache; one that is slow ends them."""
    command = [sys.executable, __file__, name, "--child", "--starts", str(options.starts), "--duration",
               str(options.duration), *(["--stops"] if options.stops else [])]  # fmt: skip
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "TWOLINK_CACHE": cache}
        try:
            done = subprocess.run(command, env=environment, capture_output=True, text=True,
                                  timeout=PATIENCE * options.limit * options.starts)  # fmt: skip
            text, late = done.stdout, Row(name, 0, outcome="crashed", why=" ".join(done.stderr.split()[-12:]))
        except subprocess.TimeoutExpired as error:
            text, late = (error.stdout or b"").decode(), Row(name, 0)
    rows = [Row(**json.loads(line)) for line in text.splitlines() if line.startswith("{")]
    return rows if len(rows) == options.starts else [*rows, replace(late, start=len(rows))]


def catalogue() -> list[str]:
    """The names of the robots that can be loaded; others are printed with the reason."""
    import twolink as tl  # in this process to list them only

    records = tl.robots().to_records()
    for record in records:
        if record["refused"]:
            print(f"refused: {record['name']}: {record['refused'][:120]}")
    return [record["name"] for record in records if not record["refused"]]


def study(options: argparse.Namespace) -> Sequence[Row]:
    """Run the robots one after the other; print and write their rows as they come."""
    rows, path = [], OUT / f"honest_catalogue{'-stops' if options.stops else ''}.csv"
    path.parent.mkdir(exist_ok=True)
    names = options.robots or catalogue()
    print(LINE.format(*COLUMNS))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        writer.writeheader()
        for name in names:
            for row in rows_of(name, options):
                rows.append(row)
                print(row, flush=True)
                writer.writerow(asdict(row))
                file.flush()
    print(f"rows in {path}")
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", help="names; all by default")
    parser.add_argument("--duration", type=float, default=2.0, help="s")
    parser.add_argument("--starts", type=int, default=3)
    parser.add_argument("--stops", action="store_true", help="with the stops of the URDF")
    parser.add_argument("--limit", type=float, default=15.0, help="seconds within which an answer counts")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        for row in answers(options.robots[0], options.starts, options.duration, stops=options.stops):
            print(json.dumps(asdict(row)), flush=True)
        return 0
    rows = study(options)
    good = sum(row.answers(options.limit) for row in rows)
    robots = {row.robot for row in rows}
    whole = robots - {row.robot for row in rows if not row.answers(options.limit)}
    print(f"{good} of {len(rows)} starts and {len(whole)} of {len(robots)} robots have a verified answer within "
          f"{options.limit:g} s; the slowest took {max(row.seconds for row in rows):.1f} s")  # fmt: skip
    return 0 if good == len(rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
