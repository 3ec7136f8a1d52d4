"""The commands that simulate, write and play: run, paper, play."""

import contextlib
import json
import re
import signal
import subprocess
from pathlib import Path

import pytest

import twolink as tl
from tests.command import TOP, TWOLINK, answer, call, one_line
from twolink.errors import ShowError


def test_run_reports_and_writes(tmp_path: Path) -> None:
    names = ["x.csv", "x.npz", "x.png", "x.html"]
    outs = [part for name in names for part in ("--out", str(tmp_path / name))]
    done = answer("run", "arm-swing", "--duration", "0.5", "--accuracy", "1e-8", *outs)
    assert done["error"] <= 1e-8
    assert done["cost"]["evaluations"] > 0
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)
    assert "not verified" in call("run", "arm-swing", "--duration", "0.1", "--no-verify").stdout
    assert answer("run", "arm-swing", "--duration", "0.1", "--no-verify")["error"] is None


@pytest.mark.slow
def test_a_stepped_scene_is_refused_only_for_an_accuracy_that_was_asked_for() -> None:
    one_line(call("run", "quadruped-stands", "--accuracy", "1e-6"), code=2, part="1e-06 would take")
    assert answer("run", "quadruped-stands")["error"] > 1e-6


def test_a_run_without_an_energy_balance_is_printed_and_written_and_says_why(tmp_path: Path) -> None:
    out = tmp_path / "x.csv"
    done = call("run", "box-stack", "--duration", "0.02", "--step", "0.002", "--book", "--out", str(out))
    assert done.returncode == 1
    assert "q(end) = " in done.stdout
    assert out.exists()
    assert done.stderr.endswith("has no smooth segments; a run with --contact located has, where contacts can be\n")


def test_run_refuses_endings_before_it_simulates(tmp_path: Path) -> None:
    out = ("--out", str(tmp_path / "x.npz"), "--out", str(tmp_path / "x.doc"))
    one_line(call("run", "arm-swing", "--duration", "1e4", *out), 2, "'.doc' is not a format we know")
    assert not list(tmp_path.iterdir())


def test_run_asks_for_a_missing_library_before_it_simulates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    out = str(tmp_path / "x.mcap")
    one_line(call("run", "arm-swing", "--duration", "1e4", "--out", out), 1, "pip install 'twolink[mcap]'")


def test_unknown_names_are_near_to_scenes_and_robots_and_a_scene_is_no_saved_run(tmp_path: Path) -> None:
    one_line(call("run", "pandda"), 1, part="no bundled scene or robot 'pandda'; did you mean 'panda'?")
    film = str(tmp_path / "x.gif")
    for command in (("play", "arm-swing", "--html", str(tmp_path / "x.html")), ("video", "arm-swing", film)):
        one_line(call(*command), 2, "make one: twolink run arm-swing --out arm-swing.npz")


def test_run_writes_into_new_folders_whatever_the_case(tmp_path: Path) -> None:
    paths = [tmp_path / "a" / "x.HTML", tmp_path / "b" / "x.CSV", tmp_path / "c" / "x.PNG"]
    answer("run", "arm-swing", "--duration", "0.1", *(part for path in paths for part in ("--out", str(path))))
    for path in paths:
        assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_run_refuses_what_cannot_be_written_before_it_simulates(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "x.npz", tmp_path / "no" / "folder" / "x.npz"):
        what = f"{path}: cannot be written: there is no folder {tmp_path}"
        one_line(call("run", "arm-swing", "--duration", "1e4", "--out", str(path)), 2, what)
    assert not (tmp_path / "no").exists()


def test_a_file_that_cannot_be_written_loses_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_run: tl.Trajectory, path: Path) -> None:
        raise ShowError("cannot be written", where=str(path))

    monkeypatch.setattr(tl.Trajectory, "plot", full)
    outs = ("--out", str(tmp_path / "x.png"), "--out", str(tmp_path / "x.npz"))
    done = call("run", "arm-swing", "--duration", "0.1", "--json", *outs)
    assert (done.returncode, done.stderr) == (1, f"twolink: {tmp_path / 'x.png'}: cannot be written\n")
    assert json.loads(done.stdout)["written"] == [str(tmp_path / "x.npz")]


def test_an_interrupted_run_keeps_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def press_ctrl_c(t: float, _total: float, _label: str) -> None:
        if t > 1:
            raise KeyboardInterrupt

    monkeypatch.setattr("twolink.cli.scenes.progress_bar", lambda: contextlib.nullcontext(press_ctrl_c))
    done = call("run", "arm-swing", "--json", "--duration", "60", "--out", str(tmp_path / "x.csv"))
    assert (done.returncode, done.stderr) == (130, "twolink: interrupted; what was done is kept\n")
    summary = json.loads(done.stdout)
    assert summary["interrupted"]
    assert 0.5 < summary["duration"] < 59
    assert tl.Trajectory.load(tmp_path / "x.csv", tl.load_robot("two_link")).t[-1] == summary["duration"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.some(2)
@pytest.mark.parametrize("arguments", [["--help"], ["query", "arm", "bias", "--q", "0 0"], ["inspect", "arm"]])
def test_output_that_cannot_be_written(arguments: list[str]) -> None:
    with open("/dev/full", "w") as full:
        command = [*TWOLINK, *arguments]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, cwd=TOP, timeout=60)
    assert done.returncode == 1
    assert done.stderr == "twolink: output: cannot be written: No space left on device; check the disk\n"


def test_play_writes_a_page(tmp_path: Path) -> None:
    run = tl.simulate(tl.load_scene("arm-swing"), 0.1)
    saved = run.save(tmp_path / "run.npz")
    assert call("play", str(saved), "--html", str(tmp_path / "run.html")).returncode == 0
    assert (tmp_path / "run.html").stat().st_size > 500_000
    table = run.save(tmp_path / "run.csv")
    assert "does not name its robot" in call("play", str(table)).stderr
    assert call("play", str(table), "--robot", "two_link", "--html", str(tmp_path / "c.html")).returncode == 0
    (upper := tmp_path / "ARM.URDF").write_text(run.robot.visuals.text, "utf-8")
    assert call("play", str(table), "--robot", str(upper), "--html", str(tmp_path / "c.html")).returncode == 0
    assert call("video", str(table), str(tmp_path / "c.png"), "--robot", "two_link").returncode == 0


@pytest.mark.parametrize("scene", ["geared-motor", "can-on-table"])
def test_runs_of_robots_that_their_scenes_change_are_drawn_by_the_scenes_name(scene: str, tmp_path: Path) -> None:
    saved, page = tl.simulate(tl.load_scene(scene), 0.1).save(tmp_path / "run.npz"), tmp_path / "run.html"
    refused = call("play", str(saved), "--html", str(page))
    one_line(refused, 1, "pass the robot of its scene: --robot")
    assert call("play", str(saved), "--html", str(page), "--robot", scene).returncode == 0
    file = tl.load_scene(scene).save(tmp_path / "mine.toml")
    assert call("video", str(saved), str(tmp_path / "x.png"), "--robot", str(file)).returncode == 0


def test_play_says_where_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    saved = tl.simulate(tl.load_scene("arm-swing"), 0.1).save(tmp_path / "run.npz")
    command = [*TWOLINK, "play", str(saved), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=TOP) as process:
        assert process.stdout is not None
        assert re.fullmatch(r"playing at http://127\.0\.0\.1:\S+ \(Ctrl-C ends it\)\n", process.stdout.readline())
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "twolink: interrupted\n")


def test_the_demo_ends_in_a_page_and_its_bars_are_below_what_was_asked_for(tmp_path: Path) -> None:
    page = tmp_path / "demo.html"
    said = call("demo", "--html", str(page)).stdout
    assert "errs in C21 and C22" in said
    bars = re.findall(r"asked for (\S+) rad: error at most (\S+) rad", said)
    assert [float(asked) for asked, _ in bars] == [1e-3, 1e-6, 1e-9, 1e-12]
    assert all(float(bar) <= float(asked) for asked, bar in bars)
    assert f"wrote {page}" in said
    assert page.stat().st_size > 100_000
