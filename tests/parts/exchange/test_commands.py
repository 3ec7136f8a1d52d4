"""The commands about other files and programs."""

import dataclasses
import json
from pathlib import Path

import twolink as tl
from tests.command import answer, call
from tests.parts.exchange.urdf_edits import child, plain_urdf, text


def test_diff_names_what_differs_and_fails(tmp_path: Path) -> None:
    arm, other = tmp_path / "arm.urdf", tmp_path / "other.urdf"
    root = plain_urdf("ur5")
    arm.write_text(text(root))
    child(next(e for e in root.iter("joint") if e.get("type") == "revolute"), "dynamics").set("damping", "0.3")
    other.write_text(text(root))
    assert answer("diff", str(arm), str(arm))["equal"]
    done = call("diff", str(arm), str(other), "--out", str(tmp_path / "d.json"))
    assert done.returncode == 1
    assert "other.urdf, joint 'shoulder_pan_joint', <dynamics damping>: damping: not in a (0; 0.3)" in done.stdout
    assert len(json.loads((tmp_path / "d.json").read_text())["differences"]) == 1


def test_run_of_a_robot_says_what_was_taken_from_its_urdf() -> None:
    record = answer("run", "talos_arm", "--duration", "0.2")
    assert any("friction" in entry["what"] for entry in record["report"]["read"])
    assert record["beyond_limits"] == [] or "beyond its limit" in record["beyond_limits"][0]


def test_judge_says_what_is_wrong_with_a_log(tmp_path: Path) -> None:
    scene = tl.load_scene("arm-swing")
    run = tl.simulate(scene, 1.0, accuracy=1e-9)
    right = str(run.save(tmp_path / "right.csv"))
    assert answer("judge", "arm-swing", right)["right"]
    assert call("judge", "arm-swing", right, "--tolerance", "1e-13").returncode == 3  # not known
    late = dataclasses.replace(run, t=run.t + 0.02)
    done = call("judge", "arm-swing", str(late.save(tmp_path / "late.csv")), "--out", str(tmp_path / "late.png"))
    assert done.returncode == 1
    assert "it is late by 0.02 s" in done.stdout
    assert (tmp_path / "late.png").stat().st_size > 10_000
    (tmp_path / "not.csv").write_text("t,q.shoulder\n0,1\n1,2\n2,3\n")
    assert "expected" in call("judge", "arm-swing", str(tmp_path / "not.csv")).stderr


def test_export_writes_c_and_urdf(tmp_path: Path) -> None:
    written = answer("export", "two_link", str(tmp_path / "arm.c"), "--functions", "mass_matrix,step:rk4")["written"]
    assert [Path(path).name for path in written] == ["arm.c", "arm.h"]
    assert "arm_step_rk4" in (tmp_path / "arm.h").read_text()
    answer("export", "panda", str(tmp_path / "p.urdf"), "--lock", "panda_joint1=0.3")
    assert call("diff", "panda", str(tmp_path / "p.urdf")).returncode == 1
    assert call("export", "two_link", str(tmp_path / "arm.c"), "--functions", "none").returncode == 2
    done = call("export", "two_link", str(tmp_path / "moon.urdf"), "--gravity", "0,0,-1.6")
    assert (done.returncode, "a URDF has no gravity" in done.stderr) == (2, True)
    assert not (tmp_path / "moon.urdf").exists()


def test_export_writes_an_fmu_of_a_scene(tmp_path: Path) -> None:
    fmu = tmp_path / "arm.fmu"
    options = ["--parameters", "gravity.z, forearm.mass"]
    assert answer("export", "arm-swing", str(fmu), *options)["written"] == [str(fmu)]
    assert fmu.read_bytes().startswith(b"PK")
    for arguments in (["arm-swing"], ["panda", str(tmp_path / "p.c"), "--fmu", str(fmu)],
                      ["two_link", str(tmp_path / "p.c"), "--platform", "x86_64-linux"],
                      ["arm-swing", "--fmu", str(fmu), "--root", "free"],
                      ["arm-swing", "--fmu", str(fmu), "--platform", "amiga"]):  # fmt: skip
        assert call("export", *arguments).returncode == 2
    done = call("export", "pitch", "--fmu", str(fmu))
    assert "JointStops cannot be in an FMU" in done.stderr
