"""The tests find a rule that is broken: ten rules of the product are changed, one at a time, in a copy of it."""

import re
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from scripts import runner


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
    "token": Mutation("a request needs a token", "parts/service/settings.py", "in compared if is_same]",
                      "in compared]", "tests/parts/service/test_access.py"),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_rule_stands_in_the_product(name: str) -> None:
    one = MUTATIONS[name]
    assert (runner.TOP / "twolink" / one.file).read_text("utf-8").count(one.text) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_a_broken_rule_is_found(name: str, tmp_path: Path) -> None:
    one = MUTATIONS[name]
    run, path = runner.tests_of_a_copy(tmp_path, ["-x", *one.tests.split()]), tmp_path / "twolink" / one.file
    path.write_text(path.read_text("utf-8").replace(one.text, one.instead), "utf-8")
    done = subprocess.run(**run, text=True, capture_output=True)
    assert re.search(r"^(?:FAILED|ERROR) \S+", done.stdout, re.MULTILINE), f"{one.rule}: {done.stdout[-2000:]}"
