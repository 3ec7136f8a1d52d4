"""Do the tests find a rule that was broken? Ten rules of the product are changed, one at a time, in a copy of it.

    python -m scripts.studies.mutations [NAME ...]

Runs the tests that should find each change, and prints which one found it first. A change that no test finds is a gap.
"""

import re
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

from scripts.runner import Table, options, print_bars, tests_of_a_copy


class Mutation(NamedTuple):
    """A rule: the text of a file that states it, what is put in its place, and the tests that should find it."""

    rule: str
    file: str
    text: str
    instead: str
    tests: str


MUTATIONS = {
    "coriolis": Mutation("-C12 stands in the first column (the paper's erratum)", "lagrange/formulas.py",
                         "((0, c12), (-c12, 0)) if", "((0, c12), (0, -c12)) if", "tests/lagrange"),
    "truncation": Mutation("a bar contains the distance to the finer solution", "simulation/error_bar.py",
                           "SAFETY = 2.5 ", "SAFETY = 0.02 ", "tests/simulation/test_error_bar.py"),
    "rounding": Mutation("a bar contains the distance to disturbed solutions", "simulation/error_bar.py",
                         "{6: 1.5, 3: 3.0, 2: 6.0, 1: 150.0}", "{6: 0.0, 3: 0.0, 2: 0.0, 1: 0.0}",
                         "tests/simulation/test_verification.py"),
    "restitution": Mutation("after an impact v+ = -e v-", "integrate/hybrid/impacts.py",
                            "return self.restitution * speed if", "return self.restitution**2 * speed if",
                            "tests/effects/test_contact.py"),
    "certificate": Mutation("friction lies within its cone", "simulation/certificate.py",
                            "np.hypot(*across) - loop.friction * normal",
                            "np.hypot(*across) - 2.0 * loop.friction * normal",
                            "tests/simulation/test_certificate.py"),
    "stops": Mutation("a robot's stops are those of its URDF", "effects/joint_switches.py",
                      "return float(lower), float(upper)", "return float(lower), 1.01 * float(upper)",
                      "tests/effects/test_joint_stops.py"),
    "damping": Mutation("the URDF's damping is read", "robots/urdf.py", '("damping", "friction", "armature")',
                        '("friction", "damping", "armature")', "tests/robots tests/effects/test_closed_forms.py"),
    "cache-key": Mutation("the name of compiled code holds the effects", "integrate/motion/equations.py",
                          "{self.content}-", "{self.operations}-", "tests/integrate"),
    "huber": Mutation("robust weights are Huber's", "parts/identification/regression.py", "HUBER = 1.345",
                      "HUBER = 13.45", "tests/parts/identification"),
    "token": Mutation("a request needs a token", "parts/service/http/messages.py", "in compared if is_same]",
                      "in compared]", "tests/parts/service/test_access.py"),
}  # fmt: skip


def found_by(one: Mutation, folder: Path) -> str:
    """The test that fails first with the change; "" if none does."""
    tests = tests_of_a_copy(folder, ["-x", *one.tests.split()])
    path = folder / "twolink" / one.file
    text = path.read_text("utf-8")
    if text.count(one.text) != 1:
        raise SystemExit(f"{one.file} states {one.text!r} {text.count(one.text)} times, expected once")
    path.write_text(text.replace(one.text, one.instead), "utf-8")
    done = subprocess.run(**tests, text=True, capture_output=True)
    if done.returncode == 0:
        return ""
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    if failed is None:
        raise SystemExit(done.stdout[-2000:] + done.stderr[-2000:])
    return failed.group(1)


def main() -> int:
    given = options(__doc__, rest=MUTATIONS)
    table = Table("rule <12 | what it says <52 | found by <60")
    for name in given.rest:
        with tempfile.TemporaryDirectory() as folder:
            table.add(name, MUTATIONS[name].rule, found_by(MUTATIONS[name], Path(folder)) or "NO TEST")
    table.save("mutations")
    found = sum(row[2] != "NO TEST" for row in table.rows)
    return 0 if print_bars([(found == len(table.rows), f"{found} of {len(table.rows)} broken rules are found")]) else 1


if __name__ == "__main__":
    raise SystemExit(main())
