"""Exit codes: 0 done, 1 failed, 2 misused, 130 interrupted; each failure is one line on stderr."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

from tests.command import TOP, call, call_process, one_line
from twolink.cli.wording import spoken

FAILED = {
    "robot": (["inspect", "pandda"], "did you mean 'panda'"),
    "states file": (["query", "arm", "bias", "--states", "none.csv"], "No such file"),
    "scene": (["run", "arm-swng"], "did you mean 'arm-swing'"),
    "play": (["play", "none.npz"], "No such file"),
    "weightless": (["inspect", "romeo"], "--lock LThumb3=0 --lock RFinger21=0"),
    "no joint": (["run", "hector", "--no-ground"], "free its base: --root free"),
}
BIAS = ["query", "arm", "bias", "--q", "0 0"]
MISUSED = {
    "command": (["inspct"], "Did you mean 'inspect'"),
    "no robot": (["inspect"], "Missing argument 'ROBOT'; see `twolink inspect --help`"),
    "root of a scene": (["run", "arm-swing", "--root", "free"], "--root: it is for robots"),
    "option": (["run", "arm-swing", "--accurac", "1"], "--accurac"),
    "words for a number": (["run", "arm-swing", "--accuracy", "high"], "--accuracy"),
    "root": (["inspect", "arm", "--root", "flying"], "root: 'flying' is unknown"),
    "n": (["check", "--n", "0"], "--n"),
    "query": (["query", "arm", "mass"], "did you mean 'mass-matrix'"),
    "no q": (["query", "arm", "bias"], "q: it is not given"),
    "shape": (["query", "arm", "bias", "--q", "0 0 0"], "q: expected shape (..., 2), got (3,)"),
    "words": (["query", "arm", "bias", "--q", "a b"], "q: 'a b' is not a list of numbers"),
    "units without joints": (["query", "arm", "bias", "--q", "30deg 20deg"], 'joint\'s name: "JOINT=20deg"'),
    "underscore": (["query", "arm", "bias", "--q", "1_0 0"], "q: '1_0 0' is not a list of numbers"),
    "deep": (["query", "arm", "bias", "--q", "[" * 100_000], "q: "),
    "tau for bias": ([*BIAS, "--tau", "1 1"], "bias takes no tau"),
    "q twice": ([*BIAS, "--states", "-"], "q: it is given twice"),
    "f_ext": (["query", "arm", "forward-dynamics", "--q", "0 0", "--f-ext", "{"], "not JSON"),
    "method": (["query", "arm", "forward-dynamics", "--q", "0 0", "--method", "crab"], "did you mean 'crba'"),
    "no frame": (["query", "arm", "frame-pose", "--q", "0 0"], "frame: it is not given"),
    "frame": (["query", "arm", "frame-pose", "--q", "0 0", "--frame", "tp"], "there is no frame 'tp'"),
    "frame of another": ([*BIAS, "--frame", "hand"], "bias takes no frame"),
    "method of another": (["query", "arm", "mass-matrix", "--q", "0 0", "--method", "crba"], "takes no method"),
    "lock": ([*BIAS, "--lock", "elbow"], "lock: expected JOINT=VALUE, got 'elbow'"),
    "lock twice": ([*BIAS, "--lock", "elbow=0", "--lock", "elbow=1"], "lock: 'elbow' is given twice"),
    "locked joint": (["inspect", "arm", "--lock", "elbw=0"], "did you mean 'elbow'"),
    "gravity": (["inspect", "arm", "--gravity", "1 2"], "gravity: expected 3 finite numbers"),
    "unphysical": (["inspect", "arm", "--unphysical", "ignore"], "unphysical: 'ignore' is unknown"),
    "duration": (["run", "arm-swing", "--duration", "-1"], "twolink: --duration: expected a time above 0 s"),
    "accuracy": (["run", "arm-swing", "--accuracy", "0"], "accuracy: expected a number above 0"),
    "integrator": (["run", "arm-swing", "--method", "rk46"], "method: 'rk46' is unknown"),
    "step": (["run", "arm-swing", "--method", "rk4", "--tolerance", "1e-5"],
             "twolink: --method: rk4 takes steps of one size; give --step\n"),
    "precision": (["run", "arm-swing", "--precision", "half"], "--precision: 'half' is unknown"),
    "ground of a scene": (["run", "arm-swing", "--ground"], "twolink: --ground: "),
    "samples": (["run", "arm-swing", "--samples-per-second", "nan"], "--samples-per-second: expected a number above 0"),
    "speed": (["play", "none.npz", "--speed", "0"], "speed: expected a number above 0"),
}  # fmt: skip


@pytest.mark.parametrize("case", FAILED)
def test_failures_are_one_line_and_exit_1(case: str) -> None:
    arguments, part = FAILED[case]
    one_line(call(*arguments), 1, part)


@pytest.mark.parametrize("case", MISUSED)
def test_misuse_is_one_line_and_exit_2(case: str) -> None:
    arguments, part = MISUSED[case]
    one_line(call(*arguments, stdin='{"q": [0, 0]}'), 2, part)


@pytest.mark.parametrize(("states", "part"), [
    ('{"v": [0, 0]}', "q: it is not given"), ('{"q": [0, 0, 0]}', "q: expected shape"), ("[", "states: not JSON"),
])  # fmt: skip
def test_a_wrong_states_file_is_no_misuse(states: str, part: str) -> None:
    one_line(call("query", "arm", "bias", "--states", "-", stdin=states), 1, part)


def test_a_process_that_fails_says_so_in_one_line() -> None:
    arguments, part = FAILED["robot"]
    one_line(call_process(*arguments), 1, part)


@pytest.mark.parametrize(("text", "spoken_text"), [
    ('purpose="kinematics" or duration=2.', "--purpose kinematics or duration=2."),
    ("hold them with lock={'j1': 0, 'j2': 0.5}", "hold them with --lock j1=0 --lock j2=0.5"),
    ("hold them with lock={'j1': [0, 0, 1, 0], 'j2': 0}", 'hold them with --lock "j1=0, 0, 1, 0" --lock j2=0'),
    ('look for parameters=["a.mass", "b.*"]', "look for --parameters a.mass,b.*"),
    ("load it with mimic=False, or mimic=True; verify=False", "load it with no --mimic, or --mimic; --no-verify"),
])  # fmt: skip
def test_remedies_have_the_syntax_of_the_command_line(text: str, spoken_text: str) -> None:
    names = {name: f"--{name}" for name in ("purpose", "lock", "parameters", "mimic")} | {"verify": "--no-verify"}
    assert spoken(text, names) == spoken_text


def test_done_is_0() -> None:
    assert call_process("query", "arm", "bias", "--q", "0 0").returncode == 0


def test_a_failed_check_exits_1(monkeypatch: pytest.MonkeyPatch) -> None:
    failed = SimpleNamespace(passed=False, text=lambda: "FAILED", to_dict=dict)
    monkeypatch.setattr("twolink.lagrange.check.check", lambda **_: failed)
    done = call("check")
    assert (done.returncode, done.stdout) == (1, "FAILED\n")


def test_a_warning_is_one_line() -> None:
    code = "import warnings; from twolink.cli import app; app.app = lambda **_: warnings.warn('beyond'); app.main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=TOP)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "twolink: warning: beyond\n")
