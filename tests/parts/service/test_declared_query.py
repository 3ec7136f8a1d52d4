"""A query that is declared once is answered by Robot, by name, over HTTP and by the client, and is described."""

import asyncio
import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import ArrayLike

import twolink as tl
from tests.dynamics.test_losses import ROBOT as LOSSY
from tests.parts.service.test_transport import ABOUT
from twolink.dynamics.queries import ALGORITHMS, QUERIES, answer_query, query
from twolink.parts.service.http.app import build
from twolink.parts.service.remote_robot import RemoteRobot
from twolink.parts.service.settings import Settings
from twolink.parts.service.store.archives import write_robot

Q, V = [0.3, -0.7], [0.1, 0.2]


class Here:
    """The transport of a client to a service in this process."""

    url = "http://localhost"

    def __init__(self, app: Any) -> None:
        self._asgi = httpx.ASGITransport(app)

    def request(
        self, method: str, path: str, body: bytes | None, media: str, accept: str, **_: bool
    ) -> tuple[str, bytes]:
        async def ask() -> httpx.Response:
            async with httpx.AsyncClient(transport=self._asgi, base_url=self.url) as client:
                headers = {"Content-Type": media, "Accept": accept}
                return await client.request(method, path, content=body, headers=headers)

        answer = asyncio.run(ask())
        assert answer.status_code == 200, answer.text
        return answer.headers["content-type"], answer.content

    def json(self, path: str, body: object = None) -> Any:
        """What is answered by JSON, to a body if there is one."""
        method, sent = ("GET", None) if body is None else ("POST", json.dumps(body).encode())
        return json.loads(self.request(method, path, sent, "application/json", "application/json")[1])


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Here]:
    """A service, after the whole of what it takes to add a query."""
    with monkeypatch.context() as patch:
        patch.setitem(QUERIES, "centroidal-map", QUERIES["bias"])  # the patch takes back what is declared here
        patch.setitem(ALGORITHMS, "centroidal_map", ALGORITHMS["bias"])

        @query({"map": ((6, "nv"), "kg m^2 or kg")}, lambda *state: pin.computeCentroidalMap(*state).copy())
        def centroidal_map(self: tl.Robot, q: ArrayLike) -> np.ndarray:
            """A_g(q), (..., 6, nv): A_g v is the momentum."""
            return self._answer("centroidal_map", "pinocchio", q)

        patch.setattr(tl.Robot, "centroidal_map", centroidal_map, raising=False)
        app = build(Settings(str(tmp_path)))
        for name, robot in (("two_link", tl.load_robot("two_link")), ("lossy", LOSSY)):
            app.service.robots.put(name, write_robot(robot))
        with contextlib.closing(app.service.store):
            yield Here(app)


def test_a_query_declared_in_one_place_is_asked_everywhere(here: Here) -> None:
    robot: Any = tl.load_robot("two_link")
    expected = robot.centroidal_map(Q)
    np.testing.assert_allclose(expected @ V, robot.momentum(Q, V), atol=1e-14)
    assert np.array_equal(robot.centroidal_map([Q, Q]), [expected, expected])
    assert np.array_equal(answer_query(robot, "centroidal-map", {"q": Q})["map"], expected)

    assert here.json("/v1/robots/two_link/centroidal-map", {"q": Q}) == {"map": expected.tolist()}

    there: Any = RemoteRobot(here, {**ABOUT, "id": "two_link"})
    assert np.array_equal(there.centroidal_map(Q), expected)
    assert "centroidal_map" in dir(there)
    assert there.centroidal_map.__doc__ == robot.centroidal_map.__doc__
    with pytest.raises(TypeError, match="unexpected keyword argument 'v'"):
        there.centroidal_map(Q, v=V)


def test_a_declared_query_is_described(here: Here) -> None:
    rows = {row["name"]: row for row in here.json("/v1/queries")}
    assert rows["centroidal-map"] == {
        "name": "centroidal-map", "method": "centroidal_map", "summary": "A_g(q), (..., 6, nv): A_g v is the momentum.",
        "arguments": {"q": "Configuration, rad or m"}, "options": {},
        "results": {"map": {"shape": [6, "nv"], "unit": "kg m^2 or kg"}},
    }  # fmt: skip
    assert rows["frame-jacobian"]["options"]["axes"]["choices"] == ["aligned", "local"]
    document = here.json("/openapi.json")
    operation = document["paths"]["/v1/robots/{robot}/centroidal-map"]["post"]
    assert operation["summary"].startswith("A_g(q)")
    answer = operation["responses"]["200"]["content"]["application/json"]["schema"]
    assert answer["properties"]["map"]["description"] == "(6, nv) for one state, kg m^2 or kg"


def test_losses_are_asked_for_by_every_face(here: Here) -> None:
    """Damping and friction in inverse dynamics: by Robot, by name, over HTTP, by the client in a batch and alone."""
    rest = [0.0, 0.0]
    expected = LOSSY.inverse_dynamics(Q, V, rest, losses=True)
    assert expected[0] - LOSSY.inverse_dynamics(Q, V, rest)[0] == pytest.approx(0.7 * V[0] + 1.5)
    assert np.array_equal(answer_query(LOSSY, "inverse-dynamics", {"q": Q, "v": V}, losses=True)["tau"], expected)

    answer = here.json("/v1/robots/lossy/inverse-dynamics", {"q": Q, "v": V, "losses": True})
    assert answer == {"tau": expected.tolist()}

    there: Any = RemoteRobot(here, {**ABOUT, "id": "lossy"})
    assert np.array_equal(there.inverse_dynamics(Q, V, rest, losses=True), expected)
    np.testing.assert_allclose(there.inverse_dynamics([Q, Q], V, rest, losses=True), [expected] * 2, rtol=1e-13)
    assert np.array_equal(there.inverse_dynamics(Q, V, rest), LOSSY.inverse_dynamics(Q, V, rest))

    rows = {row["name"]: row for row in here.json("/v1/queries")}
    takers = [name for name, row in rows.items() if "losses" in row["options"]]
    assert takers == ["inverse-dynamics"]
    assert rows["inverse-dynamics"]["options"]["losses"]["choices"] == [False, True]
    schema = here.json("/openapi.json")["components"]["schemas"]["InverseDynamics"]["properties"]["losses"]
    assert {"type": "boolean"} in schema["anyOf"]


def test_the_client_has_all_queries_of_the_robot_and_no_others() -> None:
    there = RemoteRobot(Here(None), ABOUT)
    for each in QUERIES.values():
        assert callable(getattr(tl.Robot, each.method))
        assert callable(getattr(there, each.method))
    with pytest.raises(AttributeError, match="'regressor'"):
        there.regressor(Q, V, V)
