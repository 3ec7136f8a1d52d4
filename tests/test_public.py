"""The public face: its names, what importing costs, and errors that pickle and have one root."""

import inspect
import pickle
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import twolink as tl
from twolink import errors

TOP = Path(__file__).parents[1]
FACE = {
    tl: ["Certificate", "Compiled", "Cost", "EnergyBalance", "EquationCheck", "Equilibria", "Event", "Explanation",
         "Findings", "Gradient", "Identification", "Linearization", "LoadReport", "ModelComparison", "Optimum",
         "PeriodicMotion", "Robot", "Scene", "SceneFit", "Sensitivities", "Simulation", "StepTable", "Study",
         "Trajectory", "TwolinkError", "Verdict", "Verdicts", "Worlds", "Wrench", "accuracy_study", "check_equations",
         "compare_models", "connect", "effects", "energy_book", "equilibria", "errors", "explain", "export", "fit",
         "gradient", "identify", "judge", "judge_many", "lagrange", "linearize", "lint", "load_robot", "load_scene",
         "loop_forces", "lqr", "methods", "optimize", "periodic_motion", "progress_bar", "robots", "scene_of",
         "scenes", "sensitivities", "simulate", "simulate_many", "step_table", "sweep", "trapezoidal_motion"],
    tl.Robot: ["nq", "nv", "joint_names", "neutral", "report", "model", "forward_dynamics", "inverse_dynamics",
               "mass_matrix", "bias", "coriolis", "gravity_torque", "energy", "frame_names", "frame_pose",
               "frame_velocity", "frame_jacobian", "inverse_kinematics", "forward_dynamics_derivatives",
               "inverse_dynamics_derivatives", "centre_of_mass", "momentum", "difference", "integrate", "random_state",
               "regressor", "parameter_names", "parameter_values"],
    tl.Scene: ["robot", "q", "v", "effects", "duration", "save"],
    tl.Trajectory: ["t", "q", "v", "energy", "error", "events", "cost", "save", "plot", "playback", "play", "at",
                    "tau", "scene", "end", "to_dict", "text", "summary", "acceleration", "contact_forces",
                    "to_xarray", "to_pandas"],
}  # fmt: skip


def test_the_version_is_the_same_wherever_it_stands() -> None:
    declared = tomllib.loads((TOP / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    cited = [re.search(pattern, (TOP / name).read_text("utf-8")) for name, pattern in
             (("CITATION.cff", r"(?m)^version: (\S+)$"), ("docs/cite.md", r"Version ([0-9.]+[0-9])"))]  # fmt: skip
    assert {tl.__version__, *(found[1] for found in cited if found)} == {declared}
    assert all(cited)


def test_names_are_there() -> None:
    robot = tl.load_robot("two_link")
    examples = {tl.Robot: robot, tl.Scene: tl.Scene(robot), tl.Trajectory: tl.simulate(tl.Scene(robot), 0.01)}
    for owner, names in FACE.items():
        for name in names:
            assert hasattr(examples.get(owner, owner), name), f"{owner}.{name}"
    assert sorted(tl.__all__) == FACE[tl]


def test_no_public_function_is_shadowed_by_a_module() -> None:
    import twolink.parts.design.optimize
    import twolink.parts.identification.identify
    import twolink.parts.service.client
    import twolink.simulation.energy_balance
    import twolink.simulation.explanation
    import twolink.simulation.scene_run

    assert all(
        callable(getattr(twolink, name))
        for name in tl.__all__
        if name.islower() and name not in ("effects", "errors", "lagrange")
    )


def test_public_functions_say_what_they_do() -> None:
    for name in tl.__all__:
        thing = getattr(tl, name)
        assert thing.__doc__, name
        for method, value in vars(thing).items() if inspect.isclass(thing) else ():
            if not method.startswith("_") and callable(value):
                assert value.__doc__, f"{name}.{method}"


def test_import_loads_nothing_that_is_slow() -> None:
    code = "import sys; before = set(sys.modules); import twolink; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=TOP, check=True)
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert "pinocchio" in loaded
    slow = {"matplotlib", "meshcat", "yourdfpy", "sympy", "heyoka", "typer", "pyarrow", "trimesh", "umsgpack", "zmq"}
    assert not loaded & slow
    assert "scipy.integrate" not in done.stdout


ERRORS = [e for e in vars(errors).values() if isinstance(e, type) and issubclass(e, errors.TwolinkError)]


@pytest.mark.parametrize("kind", ERRORS)
def test_errors_have_one_root_one_line_and_pickle(kind: type[errors.TwolinkError]) -> None:
    error = kind("it broke", where="there", remedy="mend it")
    assert str(error) == "there: it broke; mend it"
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is kind
    assert (again.what, again.where, again.remedy) == ("it broke", "there", "mend it")
    assert kind.__name__ in (errors.__doc__ or "")


def test_every_module_says_its_job_and_no_product_code_asserts() -> None:
    for path in (TOP / "twolink").rglob("*.py"):
        text = path.read_text()
        assert text.startswith('"""'), path
        assert not any(line.strip().startswith("assert ") for line in text.splitlines()), path


WITHOUT_SERVICE = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("litestar", "uvicorn", "prometheus_client", "httptools", "xarray", "pandas"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
"""


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=TOP, check=False)


def test_the_core_and_the_client_need_no_extra() -> None:
    code = "import twolink as tl; tl.connect; tl.simulate(tl.load_scene('arm-swing'), 0.01)"
    done = run_python(WITHOUT_SERVICE + code)
    assert done.returncode == 0, done.stderr


def test_serve_without_its_extra_names_the_command_that_installs_it(tmp_path: Path) -> None:
    arguments = ["twolink", "serve", "--data", str(tmp_path)]
    code = f"import sys; sys.argv = {arguments}; from twolink.cli.app import main; main()"
    done = run_python(WITHOUT_SERVICE + code)
    assert done.returncode == 1
    assert "pip install 'twolink[service]'" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_tab_completion_lists_the_public_names_only() -> None:
    assert set(tl.__all__) <= set(dir(tl))
    assert not {"TYPE_CHECKING", "Any", "annotations"} & set(dir(tl))
    assert all(getattr(tl, name) is not None for name in dir(tl))
