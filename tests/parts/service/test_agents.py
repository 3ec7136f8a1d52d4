"""`twolink mcp`: its tools, called by the client of the official SDK."""

import asyncio
import json
import os
import re
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import twolink as tl
from tests.urdf_text import joint, link, robot_of
from twolink.dynamics.queries import QUERIES


def server_of(folder: Path) -> Any:
    """The tools over a folder. Importing the SDK takes seconds, which processes without these tests do not need."""
    from twolink.parts.service.agents import Tools

    return Tools(folder).server()


def in_session(server: Any, work: Callable[[Any], Awaitable[Any]]) -> Any:
    """What is done with a client of the tools."""
    from mcp import Client

    async def session() -> Any:
        async with Client(server) as client:
            return await work(client)

    return asyncio.run(session())


def ask(folder: Path, *calls: tuple[str, dict], progress: list | None = None, server: Any = None) -> list:
    """The results of calls of tools in one session."""

    async def told(*progressed: object) -> None:
        if progress is not None:
            progress.append(progressed)

    async def asked(client: Any) -> list:
        return [await client.call_tool(name, given, progress_callback=told) for name, given in calls]

    return in_session(server or server_of(folder), asked)


def data(result: Any) -> dict:
    assert not result.is_error, result.content[0].text
    return result.structured_content


def test_tools_are_few_typed_and_explained(tmp_path: Path) -> None:
    tools = {tool.name: tool for tool in in_session(server_of(tmp_path), lambda client: client.list_tools()).tools}
    assert len(tools) <= 10
    for tool in tools.values():
        assert len(tool.description) > 40
        assert {"text", "data", "error", "bound", "files"} <= tool.output_schema["properties"].keys()
    assert tools["query"].input_schema["properties"]["what"]["enum"] == list(QUERIES)
    assert {name for name, tool in tools.items() if not tool.annotations.read_only_hint} == {"simulate", "export"}


def test_every_declared_query_is_answered_as_by_the_robot(tmp_path: Path) -> None:
    robot = tl.load_robot("two_link")
    state = {"q": [0.3, -0.4], "v": [1.0, 2.0], "tau": [0.1, 0.2], "a": [0.5, -0.5]}
    given = [{"robot": "two_link", "what": name, "arguments": {x: state[x] for x in query.arguments},
              "options": {"frame": "tip"} if "frame" in query.options else {}}
             for name, query in QUERIES.items() if name != "inverse-kinematics"]  # fmt: skip
    for arguments, result in zip(given, ask(tmp_path, *(("query", one) for one in given)), strict=True):
        query = QUERIES[arguments["what"]]
        expected = query.answer(robot, arguments["arguments"], **arguments["options"])
        answer = data(result)["data"]
        assert answer["units"] == {name: unit for name, (_, unit) in query.results.items()}
        for name, value in expected.items():
            np.testing.assert_allclose(answer["results"][name], value, atol=1e-12)


def test_simulate_has_a_bar_progress_and_files(tmp_path: Path) -> None:
    told: list = []
    given = {"scene": "arm-swing", "duration": 2.0, "accuracy": 1e-8, "at": [0.5, 1.0], "save": ["a.mcap", "b.png"]}
    answer = data(ask(tmp_path, ("simulate", given), progress=told)[0])
    run = tl.simulate(tl.load_scene("arm-swing"), 2.0, accuracy=1e-10)
    assert answer["bound"] == "verified"
    assert 0 < answer["error"] <= 1e-8
    for state in answer["data"]["states"]:
        assert np.abs(run.at(state["t"])[0] - state["q"]).max() <= answer["error"] + run.error.max()
    assert [Path(name).name for name in answer["files"]] == ["a.mcap", "b.png"]
    assert told
    assert all(done <= total == 2.0 for done, total, _ in told)
    again, wrong = ask(tmp_path, ("judge", {"scene": "arm-swing", "log": "a.mcap"}),
                       ("judge", {"scene": "pendulum-friction", "log": "a.mcap"}))  # fmt: skip
    assert data(again)["data"]["right"] is True
    assert wrong.structured_content["code"] == "not-a-trajectory"


def test_a_file_that_was_edited_is_read_anew(tmp_path: Path) -> None:
    given, server = {"robot": "x.urdf", "what": "gravity-torque", "arguments": {"q": [0.0]}}, server_of(tmp_path)
    for mass in (1.0, 5.0):
        text = robot_of(link("a", mass), joint("x", "prismatic", "ground", "a", "0 0 1"))
        (tmp_path / "x.urdf").write_text(text)
        found, loaded = ask(tmp_path, ("query", given), ("load_robot", {"robot": "x.urdf"}), server=server)
        assert data(found)["data"]["results"]["g"] == pytest.approx([9.81 * mass])
        assert data(loaded)["data"]["mass"] == mass


def test_a_judge_says_that_a_stepped_solution_is_an_estimate(tmp_path: Path) -> None:
    run = tl.simulate(tl.load_scene("box-stack"), 0.1)
    run.save(tmp_path / "x.csv")
    answer = data(ask(tmp_path, ("judge", {"scene": "box-stack", "log": "x.csv"}))[0])
    assert answer["bound"] == run.bound == "estimated"
    assert answer["data"]["right"]


def test_both_ways_to_judge_a_robot_begin_at_the_first_sample_of_its_log(tmp_path: Path) -> None:
    whole = tl.scene_of("two_link")
    run = tl.simulate(tl.Scene(whole.base, [0.9, -0.4], [0.3, 0.2], whole.effects, 0.5), accuracy=1e-9)
    run.save(tmp_path / "x.npz")
    log = {"t": run.t.tolist(), "q": run.q.tolist(), "v": run.v.tolist()}
    called = {"function": "judge", "arguments": {"scene": "two_link", "trajectory": log}}
    by_tool, by_call = ask(tmp_path, ("judge", {"scene": "two_link", "log": "x.npz"}), ("call", called))
    assert data(by_tool)["data"]["right"] is data(by_call)["data"]["right"] is True


@pytest.mark.slow
def test_the_other_tools(tmp_path: Path) -> None:
    found = ask(tmp_path, ("catalogue", {}), ("load_robot", {"robot": "panda"}), ("explain", {"scene": "four-bar"}),
                ("linearize", {"scene": "arm-swing"}), ("export", {"robot": "z1", "file": "z1.urdf"}),
                ("call", {"function": "compare_models", "arguments": {"a": "z1", "b": "z1.urdf"}}),
                ("accuracy_study", {"scene": "arm-swing", "duration": 0.2}))  # fmt: skip
    whole = [data(result) for result in found]
    assert "two_link" in str(whole[0])
    assert whole[5]["data"]["equal"] is True
    assert (tmp_path / "z1.urdf").is_file()


@pytest.mark.parametrize(("tool", "given", "code"), [
    ("load_robot", {"robot": "/etc/passwd"}, "not-allowed"),
    ("load_robot", {"robot": "../x.urdf"}, "not-allowed"),
    ("load_robot", {"robot": "x.xacro"}, "not-readable"),
    ("load_robot", {"robot": "x.urdf"}, "not-readable"),
    ("load_robot", {"robot": "<robot name='r'><link name='a'/><link name='a'/></robot>"}, "urdf"),
    ("simulate", {"scene": "/etc/hosts"}, "not-allowed"),
    ("simulate", {"scene": "arm-swing", "save": ["../../x.csv"]}, "not-allowed"),
    ("simulate", {"scene": "arm-swing", "accuracy": -1.0}, "accuracy"),
    ("simulate", {"scene": "arm-swong"}, "not-allowed"),
    ("query", {"robot": "two_link", "what": "no-such", "arguments": {"q": [0, 0]}}, "query"),
    ("query", {"robot": "two_link", "what": "energy", "arguments": {"q": [0, 0, 0]}}, "query"),
    ("export", {"robot": "two_link", "file": "x.exe"}, "unknown-format"),
    ("export", {"robot": "two_link", "file": "x.urdf", "functions": ["forward_dynamics"]}, "query"),
])  # fmt: skip
def test_refusals_are_data(tool: str, given: dict, code: str, tmp_path: Path) -> None:
    (result,) = ask(tmp_path, (tool, given))
    assert result.is_error
    assert result.structured_content["code"] == code
    assert result.structured_content["remedy"]
    assert code in tl.errors.codes()
    assert list(tmp_path.iterdir()) == []


def test_links_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "out.urdf").write_text("<robot name='r'><link name='a'/></robot>")
    os.symlink(tmp_path / "out.urdf", folder / "x.urdf")
    (result,) = ask(folder, ("load_robot", {"robot": "x.urdf"}))
    assert result.structured_content["code"] == "not-allowed"


XACRO = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}<link name="{}"/></robot>'
MJCF = "<mujoco>{}<worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
ESCAPES = {
    "property.urdf": XACRO.format("<xacro:property name='q' value='1'/>", "l_$(env SECRET)"),
    "yaml.xml": XACRO.format("<xacro:property name='q' value='1'/>", "l_${xacro.load_yaml('OUT/out.yaml')}"),
    "include.xacro": XACRO.format("<xacro:include filename='OUT/out.urdf'/>", "a"),
    "up.xml": MJCF.format("<include file='../out.xml'/>"),
    "absolute.xml": MJCF.format("<include file='OUT/out.xml'/>"),
    "twice.xml": MJCF.format("<include file='inner.xml'/>"),
    "folder.xml": MJCF.format("<compiler meshdir='..'/><asset><mesh name='m' file='out.stl'/></asset>"),
    "robot.toml": "robot = 'OUT/out.urdf'\nduration = 1.0\n",
    "inside.toml": "robot = 'property.urdf'\nduration = 1.0\n",
    "table.toml": "robot = 'two_link'\nduration = 1.0\n[[effects]]\ntype = 'torque'\n"
                  "inputs = {shoulder = {kind = 'sampled', file = '../out.yaml'}}\n",
}  # fmt: skip


@pytest.mark.parametrize("name", ESCAPES)
def test_what_a_file_holds_decides_and_not_its_name(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is expanded that can hold code, and no file that another one names is read outside the folder."""
    monkeypatch.setenv("SECRET", "s3cr3t")
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "out.urdf").write_text("<robot name='s3cr3t'><link name='a'/></robot>")
    (tmp_path / "out.xml").write_text(MJCF.format("").replace("<body>", "<body name='s3cr3t'>"))
    (tmp_path / "out.yaml").write_text("0,1\n1,2\n")
    (folder / "inner.xml").write_text(MJCF.format("<include file='../out.xml'/>"))
    for one, text in ESCAPES.items():
        (folder / one).write_text(text.replace("OUT", str(tmp_path)))
    tool = ("explain", {"scene": name}) if name.endswith(".toml") else ("load_robot", {"robot": name})
    (result,) = ask(folder, tool)
    assert result.is_error
    assert re.search("which can hold code|may not be read here|outside the folder", str(result.structured_content))
    assert "s3cr3t" not in str(result)


def test_text_of_a_model_names_no_file(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text(MJCF.format(""))
    for name in (tmp_path / "part.xml", "part.xml", "/etc/hostname"):
        (result,) = ask(tmp_path, ("load_robot", {"robot": MJCF.format(f"<include file='{name}'/>")}))
        assert result.structured_content["code"] == "not-allowed"


def test_models_and_meshes_of_the_folder_and_of_the_catalogue_are_read(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(MJCF.format(""))
    (tmp_path / "parts" / "m.stl").write_text("solid\n")
    (tmp_path / "all.xml").write_text("<mujoco><include file='parts/arm.xml'/></mujoco>")
    (tmp_path / "r.urdf").write_text("<robot name='r'><link name='a'><visual><geometry><mesh filename='parts/m.stl'/>"
                                     "</geometry></visual></link></robot>")  # fmt: skip
    (tmp_path / "s.toml").write_text("robot = 'panda'\nduration = 1.0\n")
    loaded = ask(tmp_path, ("load_robot", {"robot": "all.xml"}), ("load_robot", {"robot": "r.urdf"}),
                 ("load_robot", {"robot": "panda"}), ("load_robot", {"robot": MJCF.format("")}),
                 ("explain", {"scene": "s.toml"}))  # fmt: skip
    for result in loaded:
        assert "not found" not in data(result)["text"]


def test_long_answers_go_to_a_file(tmp_path: Path) -> None:
    from twolink.parts.service.agents import LARGEST

    states = np.random.default_rng(0).uniform(-1, 1, (500, 2)).tolist()
    given = {"robot": "two_link", "what": "mass-matrix", "arguments": {"q": states}}
    (result,) = ask(tmp_path, ("query", given))
    answer = data(result)
    assert len(json.dumps(answer)) + sum(len(part.text) for part in result.content) < 2 * LARGEST
    (file,) = answer["files"]
    kept = json.loads(Path(file).read_text())["data"]["results"][next(iter(QUERIES["mass-matrix"].results))]
    np.testing.assert_allclose(kept, tl.load_robot("two_link").mass_matrix(np.array(states)), atol=1e-12)


def test_over_stdin_and_stdout(tmp_path: Path) -> None:
    from mcp import StdioServerParameters

    command = StdioServerParameters(command=sys.executable, args=["-m", "twolink", "mcp", "--folder", str(tmp_path)],
                                    env=dict(os.environ))  # fmt: skip
    (answer,) = ask(tmp_path, ("query", {"robot": "two_link", "what": "energy", "arguments": {"q": [0, 0]}}),
                    server=command)  # fmt: skip
    assert data(answer)["data"]["units"]["kinetic"] == "J"
