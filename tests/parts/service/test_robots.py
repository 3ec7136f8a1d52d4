"""Robots over HTTP: list, inspect, upload, draw, delete."""

import base64
import tracemalloc
from pathlib import Path

import msgspec
import numpy as np
import pytest

import twolink as tl
from tests.parts.service.serving import URDFS, Served, mesh, pendulum, serving, stl, zipped
from twolink.parts.service.http.api_models import _from_json
from twolink.parts.service.problems import Refusal

XML, ZIP = {"Content-Type": "application/xml"}, {"Content-Type": "application/zip"}


def test_the_catalogue_is_listed_and_inspected(http: Served) -> None:
    listed = {robot["id"]: robot for robot in http.ask("/v1/robots")}
    assert listed["panda"]["origin"] == "catalogue"
    assert listed["anymal"]["usual_root"] == "free"
    about = http.ask("/v1/robots/kinova")
    robot = tl.load_robot("kinova")
    assert (about["nq"], about["nv"]) == (robot.nq, robot.nv)
    assert [joint["name"] for joint in about["joints"]] == list(robot.joint_names)
    assert about["neutral"] == robot.neutral.tolist()
    assert about["report"] == robot.report.to_dict()


def test_a_robot_has_the_scene_that_its_file_says(http: Served) -> None:
    panda, scene = http.ask("/v1/robots/panda/scene"), tl.scene_of("panda")
    read = http.ask("/v1/scenes/validate", {"scene": panda})
    assert (read["q"], read["v"], panda["duration"]) == (scene.q.tolist(), scene.v.tolist(), scene.duration)
    assert [one["type"] for one in panda["effects"]] == ["gravity", "joint-damping", "joint-stops", "coupling"]
    free = http.ask("/v1/robots", {"source": "solo12", "root": "free"})
    own, usual = (http.ask(f"/v1/robots/{id_}/scene") for id_ in (free["id"], "solo12"))
    assert "contact" in [one["type"] for one in own["effects"]]
    assert usual == own | {"robot": {"source": "solo12", "root": "free"}}
    http.ask("/v1/robots/nobody/scene", status=404)


@pytest.mark.slow
def test_uploaded_robots_are_listed_in_pages(tmp_path: Path) -> None:
    with serving(tmp_path / "data") as http:
        ids = [http.ask("/v1/robots", pendulum(name=f"r{k}"))["id"] for k in range(3)]

        def listed(query: str) -> list[dict[str, object]]:
            return [robot for robot in http.ask(f"/v1/robots?{query}") if robot["origin"] == "uploaded"]

        first = listed("limit=2")
        assert [robot["id"] for robot in first] == ids[:0:-1]
        assert "report" not in first[0]
        assert [robot["id"] for robot in listed(f"limit=2&before={first[-1]['created']!r}")] == ids[:1]
        http.ask("/v1/robots?limit=201", status=400)
        assert {robot["id"] for robot in tl.connect(http.url).robots()} > set(ids)


def test_an_upload_answers_like_the_robot_it_is(http: Served) -> None:
    text = (URDFS / "arm.urdf").read_text()
    about = http.ask("/v1/robots", text, 201, headers=XML)
    key = about["id"]
    assert http.ask("/v1/robots", text, 200, headers=XML) == about
    assert http.ask(f"/v1/robots/{key}") == about
    answer = http.ask(f"/v1/robots/{key}/forward-dynamics", {"q": [0.1, 0.2], "v": [1, 2]})
    assert answer["a"] == tl.load_robot("arm").forward_dynamics([0.1, 0.2], [1.0, 2.0], [0.0, 0.0]).tolist()


def test_options_make_another_robot(http: Served) -> None:
    text = (URDFS / "arm.urdf").read_text()
    by_query = http.ask("/v1/robots?gravity=0,0,-1.62&lock=elbow:0.5", text)
    options = {"gravity": [0, 0, -1.62], "lock": {"elbow": 0.5}}
    by_json = http.ask("/v1/robots", {"text": text, **options})
    robot = tl.load_robot(text, gravity=(0, 0, -1.62), lock={"elbow": 0.5})
    for about in (by_query, by_json):
        assert (about["nq"], about["nv"], about["gravity"]) == (robot.nq, robot.nv, robot.gravity.tolist())
    anymal = http.ask("/v1/robots", {"source": "anymal", "root": "free"})
    assert (anymal["nq"], anymal["nv"]) == (19, 18)


LARGE = 2**22 // 2  # numbers of two bytes
ZEROS = b"[" + b"0," * LARGE + b"0]"


OVERLONG = {
    "lock": b'{"source": "panda", "lock": {"a": %s}}' % ZEROS,
    "list": b'{"source": "panda", "lock": %s}' % ZEROS,
    "twice": b'{"source": "panda", "lock": {"a": %s}, "lock": {}}' % ZEROS,
    "gravity": b'{"source": "panda", "gravity": %s}' % ZEROS,
    "text": b'{"text": %s}' % ZEROS,
    "unknown": b'{"source": "panda", "more": %s}' % ZEROS,
    "names": b'{"source": "panda", "lock": {%s}}' % b",".join(b'"%d":0' % i for i in range(LARGE // 4)),
}


@pytest.mark.parametrize("name", OVERLONG)
def test_an_upload_is_counted_before_it_is_decoded(name: str) -> None:
    """Decoded, numbers take 16 times the bytes of their JSON; an upload may be 16 MB, and several come at once."""
    body = OVERLONG[name]
    tracemalloc.start()
    try:
        with pytest.raises((Refusal, msgspec.ValidationError)):
            _from_json(body)
        assert tracemalloc.get_traced_memory()[1] < 2 * len(body)
    finally:
        tracemalloc.stop()


def test_text_may_be_long_and_a_joint_has_at_most_seven_numbers() -> None:
    text = "<robot/>" + " " * LARGE
    kind, options, content = _from_json(msgspec.json.encode({"text": text, "lock": {"elbow": 0.5}}))
    assert (kind, options.lock, content) == ("urdf", {"elbow": 0.5}, text.encode())
    with pytest.raises(Refusal, match="length <= 7"):
        _from_json(b'{"source": "panda", "lock": {"a": [0,0,0,0,0,0,0,0]}}')
    with pytest.raises(Refusal, match="did you mean 'source'"):
        _from_json(b'{"sourc": "panda"}')


def test_unknown_names_are_reported_where_that_is_asked_for(http: Served) -> None:
    text = (URDFS / "arm.urdf").read_text().replace("<robot ", '<robot units="mm" ', 1)
    assert "units= is unknown" in http.ask("/v1/robots", text, 422)["detail"]
    about = http.ask("/v1/robots?foreign=report", text)
    assert "1 x units= in <robot>" in str(about["report"]["ignored"])


def test_an_mjcf_of_a_stranger_is_refused(http: Served) -> None:
    text = '<mujoco><asset><mesh name="m" file="/etc/passwd"/></asset></mujoco>'
    assert "export_urdf" in str(http.ask("/v1/robots", text, 422))


@pytest.mark.some(1)
@pytest.mark.parametrize("name", ["package://my_arm/meshes/arm.stl", "meshes/arm.stl", "../meshes/arm.stl"])
def test_meshes_come_from_the_zip(http: Served, name: str) -> None:
    urdf = "urdf/robot.urdf" if name.startswith("..") else "robot.urdf"
    content = zipped({urdf: pendulum(mesh(name)), "meshes/arm.stl": stl(), "notes.txt": "not used"})
    about = http.ask("/v1/robots", content, headers=ZIP)
    drawn = http.ask(f"/v1/robots/{about['id']}/visuals")
    assert [piece["link"] for piece in drawn["pieces"]] == ["arm"]
    data = drawn["objects"][drawn["pieces"][0]["object"]]["geometries"][0]["data"]
    assert len(base64.b64decode(data["index"]["array"]["base64"])) == 2 * 3 * int.from_bytes(stl()[80:84], "little")


@pytest.mark.slow
def test_visuals_with_the_links_poses_are_where_pinocchio_draws_them(http: Served) -> None:
    import pinocchio as pin

    robot = tl.load_robot("ur5")
    q = np.linspace(-1, 1, 6)
    drawn = http.ask("/v1/robots/ur5/visuals")
    moved = http.ask("/v1/robots/ur5/kinematics", {"q": q.tolist()})
    poses = {name: pin.XYZQUATToSE3(np.array(pose)) for name, pose in zip(moved["frames"], moved["poses"], strict=True)}
    geometry, data = robot.visual_model(), robot.model.createData()
    placed = pin.GeometryData(geometry)
    pin.updateGeometryPlacements(robot.model, data, geometry, placed, q)
    expected = {item.name: placed.oMg[i] for i, item in enumerate(geometry.geometryObjects)}
    assert len(drawn["pieces"]) == len(expected)
    for piece in drawn["pieces"]:
        at = poses[piece["link"]] * pin.XYZQUATToSE3(np.array(piece["placement"]))
        assert at.isApprox(expected[piece["name"]], 1e-6)


def test_a_scene_is_drawn_with_its_objects_where_they_are(http: Served) -> None:
    objects = [{"name": "low", "source": {"kind": "box", "size": [0.2, 0.4, 0.6]}, "pose": [1, 2, 3], "mass": 1.0},
               {"name": "top", "source": {"kind": "sphere", "radius": 0.5}, "pose": [0, 0, 1]}]  # fmt: skip
    scene = {"robot": "two_link", "objects": objects, "q": {"shoulder": 0.4, "low": [1.5, 2, 3, 0, 0, 0, 1]}}
    drawn = http.ask("/v1/scenes/visuals", {"scene": scene})
    start = http.ask("/v1/scenes/validate", {"scene": scene})
    robot = http.ask("/v1/robots/two_link/visuals")
    poses = dict(zip(start["frames"], start["poses"], strict=True))
    pieces = {piece["link"]: piece for piece in drawn["pieces"]}
    assert set(pieces) >= {"low", "top", *(piece["link"] for piece in robot["pieces"])}
    np.testing.assert_allclose(pieces["low"]["box"], [-0.1, -0.2, -0.3, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(poses["low"][:3], [1.5, 2.0, 3.0])
    np.testing.assert_allclose(np.array(poses["top"][:3]) + pieces["top"]["placement"][:3], [0.0, 0.0, 1.0])
    arm = http.ask("/v1/robots/two_link/kinematics", {"q": [0.4, 0.0]})
    for name, pose in zip(arm["frames"], arm["poses"], strict=True):
        np.testing.assert_allclose(poses[name], pose, atol=1e-15, err_msg=name)


def test_large_answers_are_compressed_for_those_who_take_that(http: Served) -> None:
    plain = http.get("/v1/robots/two_link/visuals", headers={"Accept-Encoding": "identity"})
    packed = http.get("/v1/robots/two_link/visuals", headers={"Accept-Encoding": "gzip"})
    assert "content-encoding" not in plain.headers
    assert packed.headers["content-encoding"] == "gzip"
    assert int(packed.headers["content-length"]) < 0.8 * len(plain.content)
    assert packed.content == plain.content
    refused = http.get("/v1/methods", headers={"Accept-Encoding": "br, gzip;q=0"})
    taken = http.get("/v1/methods", headers={"Accept-Encoding": "br, gzip;q=0.5"})
    assert "content-encoding" not in refused.headers
    assert taken.headers["content-encoding"] == "gzip"
    assert taken.json() == refused.json()


def test_a_zip_with_several_urdfs_names_them(http: Served) -> None:
    content = zipped({"a/one.urdf": pendulum(name="one"), "two.urdf": pendulum(name="two")})
    problem = http.ask("/v1/robots", content, 422)
    assert (problem["code"], problem["data"]) == ("several-urdfs", {"urdfs": ["a/one.urdf", "two.urdf"]})
    assert http.ask("/v1/robots?urdf=a/one.urdf", content)["name"] == "one"
    bad = zipped({"a/one.urdf": pendulum().replace('value="2"', 'value="-2"')})
    assert http.ask("/v1/robots", bad, 422)["where"].startswith("a/one.urdf:3")


def test_an_upload_is_deleted_and_the_catalogue_is_not(http: Served) -> None:
    key = http.ask("/v1/robots", pendulum(name="gone"))["id"]
    http.delete(f"/v1/robots/{key}").raise_for_status()
    http.ask(f"/v1/robots/{key}", status=404)
    http.ask(f"/v1/robots/{key}/bias", {"q": [0]}, 404)
    assert http.delete("/v1/robots/panda").status_code == 409


@pytest.mark.slow
def test_uploads_survive_a_restart_and_are_limited(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    with serving(folder, "--quota", "uploads=1", "--quota", "moving_joints=1") as http:
        key = http.ask("/v1/robots", pendulum())["id"]
        http.ask("/v1/robots", pendulum(name="b"), 429)
        http.delete(f"/v1/robots/{key}")
        assert "up to 1" in http.ask("/v1/robots", {"source": "two_link"}, 422)["detail"]
        http.ask("/v1/robots", pendulum())
        http.kill()
    with serving(folder) as http:
        assert http.ask(f"/v1/robots/{key}")["nv"] == 1
        assert len(http.ask(f"/v1/robots/{key}/bias", {"q": [0.3]})["h"]) == 1
        assert key in [robot["id"] for robot in http.ask("/v1/robots")]
