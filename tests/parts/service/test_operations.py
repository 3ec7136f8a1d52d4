"""Operations: functions of the package that the service calls; and the faces of all that it offers, held together."""

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import twolink as tl
from twolink.cli.app import app
from twolink.cli.declared import DECLARED, callback_of
from twolink.errors import QueryError, SceneError, TwolinkError
from twolink.io.docstrings import texts_of
from twolink.parts.service.client import Client
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas
from twolink.parts.service.work import requests
from twolink.parts.service.work.requests import NOT_SENT, body_of_call
from twolink.parts.service.work.scene_tasks import operate
from twolink.simulation.text import as_data

ARM = tl.load_scene("arm-swing")
SOLVED = tl.simulate(ARM, 0.5, samples_per_second=80)
RUN = {"t": SOLVED.t.tolist(), "q": SOLVED.q.tolist(), "v": SOLVED.v.tolist()}
CALLS: dict[str, dict[str, Any]] = {
    "compare_models": {"a": "world", "b": "arm"},
    "energy_book": {"scene": "arm-swing"},
    "equilibria": {"scene": "arm-swing", "starts": 4},
    "fit": {"scene": "arm-swing", "measurements": RUN, "parameters": ["forearm.mass"]},
    "gradient": {"scene": "arm-swing", "duration": 0.2, "objective": "z:forearm", "wrt": ["v.elbow"]},
    "judge": {"scene": "arm-swing", "trajectory": RUN},
    "lqr": {"scene": "arm-swing", "Q": 1.0, "R": [1.0, 2.0], "q": [0.0, 0.0]},
    "optimize": {"scene": "arm-swing", "duration": 0.2, "objective": "energy", "wrt": {"v.elbow": [-1, 1]},
                 "starts": 1},
    "periodic_motion": {"scene": "arm-swing", "period": 1.5},
    "simulate_many": {"scene": "arm-swing", "duration": 0.2, "parameters": {"v.elbow": [0.5, 1.0]}},
    "step_table": {"model": "arm-swing", "duration": 0.1, "steps": [0.01], "methods": ["Euler"]},
    "trapezoidal_motion": {"robot": "two_link", "q": [0, 0], "to": [1, 1], "acceleration": 1.0, "speed": [2, 1]},
}  # fmt: skip
MEASURED = {"seconds", "cost", "text", "title"}  # of results: they differ from run to run, or are beside them


def answer(function: str, **arguments: Any) -> dict[str, Any]:
    body = msgspec.json.encode({"operation": function, **arguments})
    return operate(body=body, robots="", quotas=Quotas(), report=lambda _: None)


@pytest.mark.parametrize("name", requests.OPERATIONS)
def test_an_operation_answers_as_its_function(name: str) -> None:
    given = dict(CALLS[name])
    found = answer(name, **given)
    for what in ("scene", "model"):
        given |= {what: ARM} if what in given else {}
    given |= {"robot": tl.load_robot("two_link")} if "robot" in given else {}
    expected = getattr(tl, name)(**given)
    plain = msgspec.to_builtins(expected) if name == "lqr" else as_data(expected)
    assert found["text"]
    assert found["title"]
    if name == "step_table":  # whose rows are timed
        assert [row["error"] for row in found["rows"]] == [row["error"] for row in plain["rows"]]
        plain = {key: value for key, value in plain.items() if key not in ("rows", "ours")}
    timed = MEASURED | ({"run", "history"} if name in ("gradient", "optimize", "periodic_motion") else set())
    sure = plain.keys() - timed
    assert {key: found[key] for key in sure} == {key: plain[key] for key in sure}


@pytest.mark.parametrize(("name", "changed", "place"), [
    ("equilibria", {"starts": -1}, "starts"),
    ("fit", {"measurements": {}}, "measurements"),
    ("gradient", {"objective": "os:system"}, "objective"),
    ("judge", {"trajectory": {"t": [0, 1]}}, "trajectory"),
    ("lqr", {"Q": []}, "Q"),
    ("optimize", {"wrt": {"v.elbow": [1]}}, "wrt['v.elbow']"),
    ("periodic_motion", {"segments": 0}, "segments"),
    ("simulate_many", {"q": 1.0}, "q"),
    ("simulate_many", {"duration": 1e6}, "duration"),
    ("step_table", {"steps": []}, "steps"),
    ("step_table", {"peer": "/etc/passwd"}, "peer"),
    ("compare_models", {"a": "/etc/passwd"}, "robot"),
    ("energy_book", {"scene": "/etc/passwd.toml"}, "scene"),
    ("trapezoidal_motion", {"acceleration": 1e-300, "to": [1e300, 1]}, "samples_per_second"),
    ("trapezoidal_motion", {"acceleration": -1.0}, "acceleration"),
    ("trapezoidal_motion", {"speed": [1.0, [2.0]]}, "speed"),
    ("trapezoidal_motion", {"q": [0, [1]]}, "q"),
    ("lqr", {"R": [[], 1.0]}, "R"),
    ("judge", {"trajectory": {**RUN, "v.elbow": [[1, 0], 2]}}, "trajectory"),
    ("step_table", {"steps": [1e-300]}, "steps"),
    ("equilibria", {"starts": 10**18}, "starts"),
    ("optimize", {"starts": 10**18}, "starts"),
    ("periodic_motion", {"segments": 10**18}, "segments"),
    ("compare_models", {"tolerance": 1e300}, "tolerance"),
])  # fmt: skip
def test_what_is_wrong_is_refused_by_its_name(name: str, changed: dict[str, Any], place: str) -> None:
    with pytest.raises(TwolinkError) as caught:
        answer(name, **CALLS[name] | changed)
    assert caught.value.where == place
    assert caught.value.remedy


def test_what_is_no_number_and_what_is_not_sent_is_refused_before_the_job() -> None:
    for changed in ({"accuracy": 0.0}, {"accuracy": "x"}, {"out": "x.toml"}, {"constraints": {}}, {"t_eval": []}):
        body = msgspec.json.encode({"operation": "optimize", **CALLS["optimize"], **changed})
        with pytest.raises(Refusal, match=next(iter(changed))):
            requests.prepare(kind="operation", body=body)


def test_an_unknown_field_is_held_against_those_of_its_operation() -> None:
    known = "known: scene, q, starts, seed, inputs, wait"
    for name, wrong, right in (("equilibria", "guess", known), ("equilibria", "effort", known),
                               ("lqr", "effrt", "did you mean 'effort'")):  # fmt: skip
        with pytest.raises(Refusal, match=f"unknown field `{wrong}`") as caught:
            requests.prepare(kind="operation", body=msgspec.json.encode({"operation": name, **CALLS[name], wrong: 1}))
        assert right in caught.value.remedy
    for body in (b'{"scene": "arm-swing"}', b'{"operation": 5}', b'{"operation": "equilibra"}', b"[]", b"{"):
        with pytest.raises((Refusal, msgspec.DecodeError)):
            requests.prepare(kind="operation", body=body)


def test_a_robot_is_judged_from_the_first_sample_of_its_log_as_by_the_function() -> None:
    whole = tl.scene_of("two_link")
    elsewhere = tl.Scene(whole.base, [0.9, -0.4], [0.3, 0.2], whole.effects, 0.5)
    run = tl.simulate(elsewhere, accuracy=1e-9)
    log = {"t": run.t.tolist(), "q": run.q.tolist(), "v": run.v.tolist()}
    assert answer("judge", scene="two_link", trajectory=log)["answer"] == tl.judge("two_link", log).answer == "right"
    assert answer("judge", scene="two_link", trajectory=log, start="scene")["answer"] == "wrong"
    settings = {"duration": 0.1, "steps": [0.01], "methods": ["Euler"]}
    (_, row), (_, expected) = (answer("step_table", model="two_link", **settings)["rows"],
                               tl.step_table("two_link", **settings).rows)  # fmt: skip
    assert row["error"] == expected.error
    with pytest.raises(SceneError, match="too long"):
        answer("step_table", model="two_link", **settings | {"duration": 1e6})


def test_an_answer_that_is_too_large_is_refused() -> None:
    body = msgspec.json.encode({"operation": "judge", **CALLS["judge"]})
    with pytest.raises(SceneError, match="the answer takes") as caught:
        operate(body=body, robots="", quotas=Quotas(answer_mb=1e-4), report=lambda _: None)
    assert caught.value.code == "too-large"


def test_a_client_calls_them_with_its_own_scenes_and_robots(client: Client) -> None:
    scene = ARM.with_effects([tl.effects.Gravity(), tl.effects.JointDamping({"elbow": 0.3})])
    here, there = tl.equilibria(scene, starts=4), client.call("equilibria", scene=scene, starts=4)
    assert there["found"][0]["q"] == pytest.approx([-np.pi / 2, 0.0])
    assert [one["q"] for one in there["found"]] == [one["q"] for one in as_data(here)["found"]]
    robot = client.robot("two_link")
    assert client.call("compare_models", a=robot, b="two_link")["equal"] is True
    motion = client.call("trapezoidal_motion", robot=robot, q=np.zeros(2), to=np.ones(2), acceleration=1.0)
    assert motion["t"][-1] == pytest.approx(2.0)
    with pytest.raises(SceneError, match="starts: expected a whole number"):
        client.call("equilibria", scene=scene, starts=-1)
    with pytest.raises(Refusal, match="did you mean 'equilibria'"):
        client.call("equilibra", scene=scene)


def test_bodies_have_the_defaults_and_texts_of_the_signature() -> None:
    def function(scene: tl.Scene, many: float = 2.0, way: str | None = None, progress: Any = None) -> None:
        """Do something.

        Parameters
        ----------
        scene : Scene
        many, way : optional
            Both
            are here.
        progress : callable
            Not sent.

        Returns
        -------
        None
        """

    body = body_of_call(function, "Body")
    assert body.__struct_fields__ == ("scene", "many", "way")
    assert body.__struct_defaults__[-2:] == (2.0, None)
    assert texts_of(function) == {"many": "Both are here.", "way": "Both are here.", "progress": "Not sent."}
    assert msgspec.json.schema(body)["$defs"]["Body"]["properties"]["many"]["description"] == "Both are here."


# What a service does not offer, or offers in another way.
ELSEWHERE = {
    "check_equations": "takes functions",
    "connect": "is the client",
    "export": "writes files, in formats of jobs and robots here",
    "judge_many": "is judge, of many",
    "lint": "reads files",
    "load_robot": "is POST /v1/robots",
    "load_scene": "is GET /v1/scenes/{scene}",
    "loop_forces": "takes a run",
    "methods": "is GET /v1/methods",
    "progress_bar": "draws in a terminal",
    "scene_of": "is GET /v1/robots/{robot}/scene",
    "scenes": "is GET /v1/scenes",
}
OFFERED = {
    "simulate": requests.JOB_KINDS["simulation"].request,
    "accuracy_study": requests.JOB_KINDS["study"].request,
    "sensitivities": requests.JOB_KINDS["sensitivity"].request,
    "identify": requests.JOB_KINDS["identification"].request,
    "sweep": requests.JOB_KINDS["sweep"].request,
    "explain": requests.explain_request(),
    "linearize": requests.linearization_request(),
    **{body.__struct_config__.tag: body for body in requests.JOB_KINDS["operation"].request.__args__},
}


def test_all_functions_of_the_package_are_offered_or_have_a_reason() -> None:
    functions = {name for name in dir(tl) if not name.startswith("_") and inspect.isfunction(getattr(tl, name))}
    assert functions - OFFERED.keys() == ELSEWHERE.keys()


@pytest.mark.parametrize("name", OFFERED)
def test_bodies_have_the_defaults_of_the_function(name: str) -> None:
    parameters, body = inspect.signature(getattr(tl, name)).parameters, OFFERED[name]
    for field in msgspec.structs.fields(body):
        if field.name in parameters:
            default = parameters[field.name].default
            assert field.default == (msgspec.NODEFAULT if default is inspect.Parameter.empty else default), field.name


# Commands: by the function what is no option of it, and why.
COMMANDS = {"run": "simulate", "accuracy": "accuracy_study", "diff": "compare_models", "steps": "step_table"}
IS_FILE = "measurements and logs are files"
NO_OPTION = {
    ("explain", "t_eval"): "nothing is simulated",
    ("explain", "samples_per_second"): "nothing is simulated",
    ("simulate", "verify"): "--no-verify",
    ("linearize", "tau"): "zero, or what holds the state",
    ("optimize", "t_eval"): "objectives have the run's own samples",
    ("optimize", "samples_per_second"): "objectives have the run's own samples",
    ("optimize", "constraints"): "--at-least, --at-most",
    ("optimize", "curvature"): "always",
    ("optimize", "derivatives"): "of the kind that there is",
    **{("identify", name): IS_FILE for name in ("t", "q", "v", "tau", "a")},
    ("identify", "coupling"): "in the file of columns",
    ("fit", "measurements"): IS_FILE,
    ("judge", "trajectory"): IS_FILE,
    ("judge", "accuracy"): "follows from the tolerance",
    ("step_table", "model"): "the command's argument",
    ("step_table", "steps"): "--step",
    ("step_table", "methods"): "all of them",
    ("step_table", "accuracy"): "follows from the steps",
    ("sweep", "scene"): "the command's argument",
    ("sweep", "verify"): "--no-verify",
    ("sweep", "chunk"): "by the number of runs",
    ("lint", "robot"): "the command's arguments",
    ("gradient", "slopes"): "a function of Python",
    ("energy_book", "run"): "its own",
}
# Options that are left out mean the default of the function, or of a bundled sweep.
MEANS_DEFAULT = {("explain", "accuracy"), ("identify", "find"), ("lint", "package_dirs")}


def commands() -> Iterator[tuple[str, Any]]:
    for command in app.registered_commands:
        name = (command.name or command.callback.__name__).replace("-", "_")
        name = COMMANDS.get(name, name)
        if name in OFFERED or name == "lint":
            yield name, command.callback
    for declared in DECLARED.values():
        yield declared.load().__name__, callback_of(declared)


def test_commands_have_the_arguments_and_defaults_of_the_function() -> None:
    missing: set[tuple[str, str]] = set()
    for name, command in commands():
        options = inspect.signature(command).parameters
        for parameter in inspect.signature(getattr(tl, name)).parameters.values():
            option, place = options.get(parameter.name), (name, parameter.name)
            if option is None:
                missing |= {place} if parameter.name not in NOT_SENT else set()
            elif place not in MEANS_DEFAULT and not (name == "sweep" and option.default is None):
                assert option.default == parameter.default, place
    assert missing == NO_OPTION.keys() - {("step_table", "model")}


def test_an_agent_that_calls_what_is_not_there_is_told_what_is(tmp_path: Path) -> None:
    from twolink.parts.service.agents import Tools  # the SDK takes seconds to import

    with pytest.raises(QueryError, match="equilibria"):
        Tools(tmp_path).call("equilibrium", {})
