"""Hundreds of hostile bodies: each is refused with a problem, none ends the service, none shows a file."""

import time

import httpx
import pytest

from tests.parts.service.hostile import Case, cases
from tests.parts.service.serving import Served


def sent(http: httpx.Client, case: Case) -> httpx.Response:
    return http.post(case.path, content=case.body, headers={"Content-Type": case.media})


@pytest.mark.slow
def test_each_is_refused_and_the_service_goes_on(served: Served, http: httpx.Client) -> None:
    corpus = cases()
    assert len(corpus) >= 200
    wrong = []
    for case in corpus:
        answer = sent(http, case)
        if answer.status_code == 202:
            answer = http.get(f"{answer.headers['location']}/events")  # jobs say it at their end
            if '"state":"failed"' not in answer.text:
                wrong.append((case.name, answer.text[-200:]))
        elif not 400 <= answer.status_code < 500:
            wrong.append((case.name, f"{answer.status_code} {answer.text[:200]}"))
        elif answer.headers["content-type"] != "application/problem+json" or not answer.json()["detail"]:
            wrong.append((case.name, answer.text[:200]))
        if "root:" in answer.text or "Traceback" in answer.text:
            wrong.append((case.name, answer.text[:200]))
    assert not wrong, "\n".join(f"{name}: {what}" for name, what in wrong)
    assert served.process.poll() is None
    assert "unexpected" not in served.log
    assert http.post("/v1/robots/two_link/bias", json={"q": [0, 0]}).status_code == 200
    states = [job["state"] for job in http.get("/v1/simulations").json()]
    assert "running" not in states


def test_slow_clients_do_not_starve_others(served: Served, http: httpx.Client) -> None:
    slow = [served.connect() for _ in range(300)]
    try:
        for k, connection in enumerate(slow):
            part = b"POST /v1/robots/two_link/bias HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n"
            connection.sendall(part[: k % 90] if k % 2 else part + b"\r\n{")
        start = time.monotonic()
        assert all(http.post("/v1/robots/two_link/bias", json={"q": [0, 0]}).status_code == 200 for _ in range(50))
        assert time.monotonic() - start < 60  # they would be starved for longer
    finally:
        for connection in slow:
            connection.close()
    assert http.get("/health").status_code == 200
    assert "Traceback" not in served.log  # when they go in the middle
