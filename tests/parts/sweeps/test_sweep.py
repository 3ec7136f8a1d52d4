"""tl.sweep: what the store holds is what `simulate` gives, whatever computes it."""

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

import twolink as tl
from tests.refusals import refusal
from tests.urdf_text import joint, link, robot_of
from twolink import effects
from twolink.errors import MissingExtraError, SceneError, TwolinkError
from twolink.parts.sweeps import store
from twolink.parts.sweeps.plan import origin
from twolink.sweeps import open_sweep

pytest.importorskip("zarr")
ARM = tl.load_scene("arm-swing")
ELBOWS, MASSES = [-0.4, 0.1, 0.5], [1.0, 1.5]
GRID = {"q.elbow": ELBOWS, "forearm.mass": MASSES}
HERE = ThreadPoolExecutor(1)  # computes in this process


def swept(out: Path, vary: dict = GRID, scene: tl.Scene = ARM, **options):
    return tl.sweep(scene, vary=vary, out=out, **{"duration": 1.0, "executor": HERE, **options})


def stop(*_: object) -> None:
    raise KeyboardInterrupt


def test_a_grid_in_worker_processes_is_what_simulate_gives(tmp_path: Path) -> None:
    data = swept(tmp_path / "x.zarr", executor=None, workers=2, chunk=2, outputs=["final", "cost"])
    assert dict(data.sizes) == {"q.elbow": 3, "forearm.mass": 2, "q_name": 2, "v_name": 2}
    assert (data.status == 1).all()
    assert (data.error <= 1e-6).all()
    assert data["q.elbow"].attrs["units"] == "rad"
    for elbow in ELBOWS:
        worlds = tl.simulate_many(ARM, q=[0.0, elbow], parameters={"forearm.mass": MASSES}, duration=1.0)
        found = data.sel({"q.elbow": elbow})
        assert np.array_equal(found.q, worlds.q)
        assert np.array_equal(found.error, worlds.error)
        assert np.array_equal(found.steps, worlds.steps)


def test_bits_do_not_depend_on_the_engine_the_workers_or_the_chunks(tmp_path: Path) -> None:
    rubbing = tl.Scene(ARM.base, effects=[effects.Gravity(), effects.DryFriction(kinetic={"elbow": 0.5})])
    vary = {"effects.1": [True, False], "accuracy": [1e-4, 1e-6], "q.elbow": [0.1, 0.2, 0.3]}
    ways = [{"chunk": 1}, {"chunk": 5}, {}, {"executor": None, "workers": 1, "chunk": 4}]
    asked = {"outputs": ["final", "samples", "energy"], "samples_per_second": 3}
    first, *others = (swept(tmp_path / f"{i}.zarr", vary, rubbing, **asked, **way) for i, way in enumerate(ways))
    assert (first.status == 1).all()
    for other in others:
        for name in ("q", "v", "error", "t", "energy", "q_samples", "status", "reason"):
            assert np.array_equal(first[name], other[name]), name


def test_where_no_accuracy_is_asked_for_contacts_are_stepped_as_well_as_by_simulate(tmp_path: Path) -> None:
    scene, duration = tl.load_scene("dominoes"), 0.1
    data = swept(tmp_path / "x.zarr", {"v.domino_1.0": [0.0, 0.1]}, scene, duration=duration)
    assert data.status.values.tolist() == [1, 1]
    assert "errors are estimates" in data.attrs["how"]
    assert "or of stepped contacts an estimate" in data.error.attrs["long_name"]
    for speed, q, error in zip([0.0, 0.1], data.q.values, data.error.values, strict=True):
        run = tl.simulate(scene.with_start(scene.q, [speed, *scene.v[1:]]), duration, t_eval=[0.0, duration])
        assert error == run.error[-1] < 1e-4
        assert np.array_equal(run.q[-1], q)
    asked = swept(tmp_path / "y.zarr", {"v.domino_1.0": [0.1]}, scene, duration=duration, accuracy=1e-3)
    assert asked.error[0] <= 1e-3
    assert asked.status[0] == 1


def test_a_robot_whose_file_was_edited_is_another_one(tmp_path: Path) -> None:
    def written(name: str, mass: float) -> str:
        text = robot_of(link("a", mass), joint("x", "prismatic", "ground", "a", "0 0 1"))
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)

    def energy(*robots: str, out: str = "x.zarr") -> list[float]:
        scene, vary = ARM.with_effects([effects.Gravity()]), {"robot": list(robots)}
        return swept(tmp_path / out, vary, scene, outputs=["energy"]).energy.values.tolist()

    light, heavy = written("light.urdf", 1.0), written("heavy.urdf", 3.0)
    (one,) = energy(light)
    assert energy(light, heavy, "two_link")[:2] == pytest.approx([one, 3 * one])  # goes on with it
    written("light.urdf", 2.0)
    with pytest.raises(SceneError, match=r"another sweep: robots\..*light\.urdf was"):
        energy(light, heavy, "two_link")
    assert energy(light, heavy, out="y.zarr") == pytest.approx([2 * one, 3 * one])  # workers that live have not kept it


def test_a_smooth_sweep_without_an_accuracy_is_that_of_1e_6(tmp_path: Path) -> None:
    swept(tmp_path / "x.zarr")
    again = swept(tmp_path / "x.zarr", accuracy=1e-6)  # goes on with it
    assert (again.error <= 1e-6).all()


def test_a_run_that_fails_is_a_row_with_its_reason(tmp_path: Path) -> None:
    data = swept(tmp_path / "x.zarr", {"forearm.mass": [1.0, -1.0, 2.0]})
    assert data.status.values.tolist() == [1, 3, 1]
    assert "expected at least 0, got -1" in str(data.reason.values[1])
    assert np.isnan(data.q.values[1]).all()
    whole = tl.simulate_many(ARM, parameters={"forearm.mass": [1.0, 2.0]}, duration=1.0)
    assert np.array_equal(data.q.values[[0, 2]], whole.q)


def test_it_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    def stop(done: int, total: int, label: str) -> None:
        assert "runs/s" in label
        if done >= 2 * total / 3:
            raise KeyboardInterrupt

    part = swept(tmp_path / "x.zarr", chunk=1, progress=stop)
    assert (part.status.values.ravel()[:4] == 1).all()
    assert (part.status == 0).sum() == 2
    calls: list[int] = []
    whole = swept(tmp_path / "x.zarr", chunk=1, progress=lambda done, _total, _label: calls.append(done))
    assert calls == [5, 6]
    assert whole.equals(swept(tmp_path / "y.zarr"))


def test_another_sweep_is_refused_and_the_difference_is_named(tmp_path: Path) -> None:
    swept(tmp_path / "x.zarr")
    other = tl.Scene(ARM.base, effects=[effects.Gravity(field=(0.0, 0.0, -1.6))])
    for options, part in (
        ({"accuracy": 1e-5}, "accuracy was 1e-06 and is now 1e-05"),
        ({"scene": other}, "scene.effects[0].field[2] was -9.81 and is now -1.6"),
        ({"vary": {"q.elbow": ELBOWS, "forearm.mass": [1.0]}}, "forearm.mass had the value 1.5"),
        ({"vary": {"q.elbow": ELBOWS}}, "vary"),
    ):
        with refusal(SceneError, code="another-sweep", match="another sweep") as caught:
            swept(tmp_path / "x.zarr", **options)
        assert part in str(caught.value)


BAR = """<robot name="bar"><link name="w"/><link name="a"><inertial><origin xyz="0.3 0 0"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.6 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
    <joint name="j" type="revolute"><parent link="w"/><child link="a"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="2" effort="9" velocity="9"/><dynamics damping="0.5"/></joint><link name="tool"/>
    <joint name="t" type="fixed"><parent link="a"/><child link="tool"/><origin xyz="0.5 0 0"/></joint></robot>"""


@pytest.mark.parametrize("edit", ["damping", "stop", "tool", "shape"])
def test_a_robot_file_that_was_edited_is_another_sweep(edit: str, tmp_path: Path) -> None:
    effect, old, new = {
        "damping": (effects.JointDamping(), 'damping="0.5"', 'damping="5"'),
        "stop": (effects.JointStops(restitution=0.5), 'upper="2"', 'upper="0.6"'),
        "tool": (effects.FrameWrench("tool", force=(0.0, 0.0, 3.0)), 'xyz="0.5', 'xyz="1.5'),
        "shape": (effects.Contact("ground", restitution=0.9), 'radius="0.1"', 'radius="0.5"'),
    }[edit]
    high = BAR.replace('<parent link="w"/>', '<parent link="w"/><origin xyz="0 0 1"/>')
    before, after = (tl.Scene(tl.load_robot(text), effects=[effects.Gravity(), effect])
                     for text in (high, high.replace(old, new)))  # fmt: skip
    swept(tmp_path / "x.zarr", {"v.j": [0.0]}, before, duration=0.1)
    with pytest.raises(SceneError, match=r"scene\.robot\.content was"):
        swept(tmp_path / "x.zarr", {"v.j": [0.0, 0.1]}, after, duration=0.1)


class Push:
    """A law whose torque is a state of its object."""

    def __init__(self, torque: float) -> None:
        self.torque, self.names = torque, {"shoulder", "elbow", "wrist", "hand"}

    def law(self, _t: float, _y: object, state: object) -> tuple[np.ndarray, object]:
        return np.array([self.torque, 0.0]), state


def test_a_controller_that_was_changed_is_another_sweep(tmp_path: Path) -> None:
    weak, strong = (tl.Scene(ARM.base, effects=[effects.Controller(Push(x).law, 0.05)]) for x in (1.0, 2.0))
    first = swept(tmp_path / "x.zarr", {"v.elbow": [0.0]}, weak, duration=0.2)
    again = swept(tmp_path / "x.zarr", {"v.elbow": [0.0]}, tl.Scene(weak.base, effects=weak.effects), duration=0.2)
    assert again.equals(first)
    with pytest.raises(SceneError, match=r"effects\[0\]\.update\.content was"):
        swept(tmp_path / "x.zarr", {"v.elbow": [0.0, 0.1]}, strong, duration=0.2)


def test_a_controller_with_a_set_is_the_same_in_another_process() -> None:
    code = "from tests.parts.sweeps.test_sweep import Push; from twolink.parts.sweeps.plan import _content; "
    code += "print(_content(Push(1.0).law))"
    found = {
        subprocess.run([sys.executable, "-c", code], env={**os.environ, "PYTHONHASHSEED": seed}, text=True, check=True,
                       capture_output=True).stdout
        for seed in "123"
    }  # fmt: skip
    assert len(found) == 1


def test_a_store_of_an_earlier_version_is_refused_in_words(tmp_path: Path) -> None:
    swept(tmp_path / "x.zarr")
    group, record = store.read_record(tmp_path / "x.zarr")
    del record["plan"]["functions"], record["plan"]["scene"]["robot"]["content"]
    group.attrs["twolink"] = json.dumps(record)
    with refusal(SceneError, code="another-sweep", match="an earlier version did not note the content"):
        swept(tmp_path / "x.zarr")
    assert (open_sweep(tmp_path / "x.zarr").status == 1).all()


def test_a_network_that_was_trained_again_is_another_sweep(tmp_path: Path) -> None:
    written, ends, file = pytest.importorskip("tests.effects.test_policies").written, [], tmp_path / "x.onnx"
    for push in (1.0, 2.0):
        weights = {"w": np.zeros((4, 2)), "b": [push, 0.0]}
        written(file, [("Gemm", "x w b", "y", {})], weights, {"x": [1, 4]}, {"y": [1, 2]})
        scene = tl.Scene(ARM.base, effects=[effects.Policy(str(file), 0.05)])
        ends.append(swept(tmp_path / f"{push}.zarr", {"v.elbow": [0.0]}, scene, duration=0.2).q.values[0])
        assert ends[-1] == pytest.approx(tl.simulate(scene, 0.2).q[-1], abs=1e-9)
    assert abs(ends[1] - ends[0]).max() > 1e-3
    with pytest.raises(SceneError, match=r"effects\[0\]\.content was"):
        swept(tmp_path / "1.0.zarr", {"v.elbow": [0.0, 0.1]}, scene, duration=0.2)


def test_a_larger_grid_computes_the_new_runs_only(tmp_path: Path) -> None:
    swept(tmp_path / "x.zarr", chunk=2)
    done: list[int] = []
    more = {"q.elbow": [-0.4, -0.1, 0.1, 0.5], "forearm.mass": [1.0, 1.5, 2.0]}
    data = swept(tmp_path / "x.zarr", more, progress=lambda d, _total, _label: done.append(d), chunk=4)
    assert done[0] > 6
    assert done[-1] == 12
    assert data.equals(swept(tmp_path / "y.zarr", more))
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".x") and path.suffix != ".lock"] == []


def test_a_grid_goes_on_in_another_order_of_what_varies(tmp_path: Path) -> None:
    swept(tmp_path / "x.zarr", chunk=1, progress=stop)
    turned = dict(reversed(GRID.items()))
    more = turned | {"q.elbow": [*ELBOWS, 0.6]}
    whole, data = (swept(tmp_path / "x.zarr", vary, chunk=1) for vary in (turned, more))
    assert whole.equals(swept(tmp_path / "y.zarr"))
    assert data.equals(swept(tmp_path / "z.zarr", dict(reversed(more.items()))))


def test_another_machine_that_goes_on_is_in_the_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = json.loads(swept(tmp_path / "x.zarr", chunk=1, progress=stop).attrs["twolink"])
    assert "resumed" not in here
    other = {**origin(), "machine": "another one"}
    monkeypatch.setattr(store, "origin", lambda: other)
    for vary in (GRID, GRID, {**GRID, "q.elbow": [*ELBOWS, 0.6]}):  # goes on, has nothing to do, is extended
        record = json.loads(swept(tmp_path / "x.zarr", vary, chunk=1).attrs["twolink"])
        assert record["resumed"] == [other]
        assert {name: record[name] for name in other} == {name: here[name] for name in other}


def test_samples_by_a_seed_and_more_of_them(tmp_path: Path) -> None:
    vary = {"q.elbow": {"uniform": [-1.0, 1.0]}, "forearm.mass": {"normal": [1.0, 0.01]}}
    few = swept(tmp_path / "x.zarr", vary, design="sobol", count=5, seed=3).load()
    done: list[int] = []
    many = swept(tmp_path / "x.zarr", vary, design="sobol", count=8, seed=3, progress=lambda d, *_: done.append(d))
    assert done == [8]
    assert many.isel(run=slice(5)).equals(few)
    assert set(many.coords) >= {"run", "q.elbow", "forearm.mass"}
    assert len(np.unique(many["q.elbow"])) == 8
    for design in ("random", "latin-hypercube"):
        assert (swept(tmp_path / f"{design}.zarr", vary, design=design, count=4).status == 1).all()


def test_a_function_of_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own_module.py").write_text("def change(run):\n    return float(run.energy[-1] - run.energy[0])\n")
    monkeypatch.syspath_prepend(tmp_path)
    data = swept(tmp_path / "x.zarr", {"q.elbow": [0.1, 0.2]}, outputs=["own_module:change"])
    assert (np.abs(data.change) < 1e-5).all()
    (tmp_path / "own_names.py").write_text("def t(run):\n    return 0.0\n\nq_name = run = status = t\n")
    for name in ("t", "q_name", "run", "status"):
        with pytest.raises(SceneError, match=f"two arrays of the store would be called '{name}'"):
            swept(tmp_path / "w.zarr", outputs=["final", f"own_names:{name}"])
    with pytest.raises(SceneError, match="cannot be imported"):
        swept(tmp_path / "y.zarr", outputs=["no_such:thing"])
    with pytest.raises(SceneError, match="cannot be imported"):
        swept(tmp_path / "z.zarr", outputs=["own_module:change"], executor=Elsewhere())
    assert (open_sweep(tmp_path / "z.zarr").status == 0).all()


def test_limits_of_effort_are_events_as_simulate_has_them(tmp_path: Path) -> None:
    limited = effects.PID({"elbow": 0.2}, kp={"elbow": 30.0}, effort={"elbow": 2.0})
    scene = tl.Scene(ARM.base, effects=[effects.Gravity(), limited], duration=0.4)
    data = swept(tmp_path / "x.zarr", {"q.elbow": ELBOWS}, scene, duration=0.4, outputs=["final", "events"])
    for i, elbow in enumerate(ELBOWS):
        run = tl.simulate(tl.Scene(ARM.base, {"elbow": elbow}, effects=scene.effects), 0.4)
        np.testing.assert_allclose(data.q.values[i], run.q[-1], atol=2e-6)
        times = [event["t"] for event in json.loads(str(data.events.values[i]))]
        np.testing.assert_allclose(times, [event.t for event in run.events], atol=1e-5)
        assert data.event_count.values[i] == len(times)
    assert data.event_count.values.sum() > 2
    assert "limits of effort" in data.attrs["how"]
    stops = tl.Scene(ARM.base, effects=[effects.Gravity(), effects.JointStops({"elbow": (-1.0, 1.0)})])
    other = swept(tmp_path / "y.zarr", {"q.elbow": [0.1]}, stops, outputs=["events"])
    assert "limits of effort" not in other.attrs["how"]


def test_runs_are_reproducible_from_the_first_one_on(tmp_path: Path) -> None:
    data = swept(tmp_path / "x.zarr", {"q.elbow": [0.1]}, outputs=["tests.parts.sweeps.run_functions:reproducible"])
    assert data.reproducible.values.tolist() == [1.0]


def test_robots_differ_under_the_same_effects(tmp_path: Path) -> None:
    vary = {"robot": ["two_link", "no_such_robot", "double_pendulum"], "accuracy": [1e-4, 1e-8]}
    data = swept(tmp_path / "x.zarr", vary, duration=0.2, outputs=["cost", "energy"])
    assert data.status.sel(robot="no_such_robot").values.tolist() == [3, 3]
    assert "no_such_robot" in str(data.reason.sel(robot="no_such_robot").values[0])
    robot = tl.load_robot("double_pendulum")
    q, v = robot.random_state(1, seed=0)
    alone = tl.Scene(robot, q[0], v[0], ARM.effects).robot.energy(q[0], v[0])
    found = data.sel(robot="double_pendulum")
    np.testing.assert_allclose(found.energy, sum(alone), atol=1e-3)
    assert (found.error <= found.accuracy).all()
    assert "robots differ" in data.attrs["how"]
    for outputs, vary in ((["final"], {"robot": ["arm"]}), (["cost"], {"robot": ["arm"], "q.elbow": [0.1]})):
        with pytest.raises(SceneError, match="robot"):
            swept(tmp_path / "y.zarr", vary, outputs=outputs)


class Job:
    """As submitit's: no future of concurrent.futures."""

    def __init__(self, function: Callable[..., object], task: object) -> None:
        self._function, self._task = function, task

    def done(self) -> bool:
        return True

    def result(self) -> object:
        return self._function(self._task)

    def cancel(self) -> None:
        """Nothing is left to do."""


class Cluster:
    """As submitit's executor."""

    def submit(self, function: Callable[..., object], task: object) -> Job:
        return Job(function, task)


class Elsewhere(Cluster):
    """A cluster whose workers have twolink, and no module of the caller's own."""

    def submit(self, function: Callable[..., object], task: object) -> Job:
        def there(task: object) -> object:
            sys.modules.pop("own_module", None)
            own, sys.path[:] = sys.path.copy(), [place for place in sys.path if "pytest-" not in place]
            try:
                return function(task)
            finally:
                sys.path[:] = own

        return Job(there, task)


class Stranger(Cluster):
    """A cluster whose workers have no twolink."""

    def submit(self, _function: Callable[..., object], task: object) -> Job:
        return Job(lambda _: importlib.import_module("no_such_module"), task)


def test_an_executor_of_another_kind(tmp_path: Path) -> None:
    data = swept(tmp_path / "x.zarr", executor=Cluster(), chunk=2)
    assert data.equals(swept(tmp_path / "y.zarr"))
    with refusal(TwolinkError, code="workers-differ", match="workers cannot import"):
        swept(tmp_path / "z.zarr", executor=Stranger())
    with pytest.raises(SceneError, match="an address or an executor"):
        swept(tmp_path / "z.zarr", executor=3)


@pytest.mark.parametrize("library", ["zarr", "xarray"])
def test_nothing_is_computed_where_a_library_is_missing(library: str, tmp_path: Path) -> None:
    missing = pytest.raises(MissingExtraError, match=f"{library} is not installed")
    with patch.dict(sys.modules, {library: None}), missing:
        swept(tmp_path / "x.zarr")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("workers", [0, -1, 1.5])
def test_a_number_of_workers_that_cannot_be_is_refused(workers: float, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="workers"):
        swept(tmp_path / "x.zarr", executor=None, workers=workers)


def test_no_store_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no store"):
        open_sweep(tmp_path)
    with pytest.raises(SceneError, match="no store"):
        swept(tmp_path)


@pytest.mark.parametrize(("vary", "part"), [
    ({"q.elbo": [0.0]}, "did you mean 'q.elbow'"), ({}, "values by name"), ({"q.elbow": [np.nan]}, "finite"),
    ({"q.elbow": [0.1, 0.1]}, "twice"), ({"effects.0": [0.5]}, "true or false"), ({"accuracy": [0.0]}, "above 0"),
    ({"q.elbow": {"range": [0, 1]}}, "range with 3 numbers"),
])  # fmt: skip
def test_refusals(vary: dict, part: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=part):
        swept(tmp_path / "x.zarr", vary)
    assert not (tmp_path / "x.zarr").exists()
