"""docs/operating.md and the files beside it say what is so: commands, quotas, metrics and fields of the log."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml  # type: ignore[import-untyped]

from tests.command import call, one_line
from tests.parts.service.serving import TOP, Served, wait_until
from twolink.errors import TwolinkError
from twolink.parts.service.http.messages import AccessControl
from twolink.parts.service.logs import Answered
from twolink.parts.service.problems import Refusal
from twolink.parts.service.settings import Quotas, Settings

TEXT = (TOP / "docs/operating.md").read_text(encoding="utf-8")
UNIT = TOP / "docs/operating/twolink.service"
CONTAINER = (TOP / "docs/operating/Containerfile").read_text(encoding="utf-8")


def started_with(text: str) -> list[str]:
    """The options of the `twolink serve` in a unit or a container file."""
    line = next(line for line in text.splitlines() if line.startswith(("ExecStart=", "ENTRYPOINT ")))
    words = shlex.split(re.sub(r'[\[\],"]', " ", line))
    return words[words.index("serve") + 1 :]


@pytest.mark.parametrize("text", [UNIT.read_text(encoding="utf-8"), CONTAINER])
def test_the_commands_have_options_that_there_are(text: str) -> None:
    done = call("serve", *started_with(text), "--quota", "help")
    assert (done.returncode, done.stderr) == (0, "")


def test_the_services_of_the_group_have_options_and_parts_that_there_are() -> None:
    compose = yaml.safe_load((TOP / "docs/operating/compose.yaml").read_text(encoding="utf-8"))
    own = compose["services"]["twolink"]
    done = call("serve", *started_with(CONTAINER), *own["command"], "--quota", "help")
    assert (done.returncode, done.stderr) == (0, "")
    assert (TOP / "docs/operating" / own["build"]["context"] / own["build"]["dockerfile"]).resolve().exists()
    assert set(own["environment"]) == {"TWOLINK_TOKEN", "TWOLINK_DATABASE"}
    assert {volume.partition(":")[0] for volume in own["volumes"]} <= set(compose["volumes"])


@pytest.mark.parametrize("given", [
    {"database": "postgresql://db/x"}, {"store": "s3://bucket"}, {"database": "mysql://db/x", "store": "s3://bucket"},
    {"root_path": "twolink"}, {"root_path": "/twolink/"}, {"root_path": "/a b"},
])  # fmt: skip
def test_what_makes_no_service_for_a_group_is_refused(given: dict[str, str]) -> None:
    with pytest.raises(TwolinkError, match="such as"):
        Settings("data", **given)


def test_a_database_that_cannot_be_reached_is_refused_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("psycopg")
    urls = "--database", f"postgresql:///x?host={tmp_path}", "--store", f"file://{tmp_path}/objects"
    one_line(call("serve", "--port", "0", "--data", str(tmp_path / "data"), *urls), 1, "--database")


def test_the_container_takes_files_that_there_are() -> None:
    for sources in re.findall(r"^COPY (?!--from)(.+) \S+$", CONTAINER, re.MULTILINE):
        assert all((TOP / source).exists() for source in sources.split())


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    copy = tmp_path / UNIT.name
    copy.write_text(UNIT.read_text(encoding="utf-8").replace("/opt/twolink/bin/twolink", shutil.which("true") or ""))
    done = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


def test_quotas_have_the_defaults_that_the_table_says() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (\d+) \|", TEXT, re.MULTILINE)
    assert len(rows) >= 6
    assert {name: getattr(Quotas(), name) for name, _ in rows} == {name: float(value) for name, value in rows}


def test_the_metrics_are_those_of_the_table(http: Served) -> None:
    http.post("/v1/robots/two_link/bias", json={"q": [0, 0]})
    wait_until(lambda: "twolink_loop_lag_seconds_count 0.0" not in http.get("/metrics").text)
    text = http.get("/metrics").text
    assert re.search(r'\ntwolink_requests_total\{route="bias",status="200"\} \d+', text)
    assert "\nprocess_resident_memory_bytes " in text
    shown = set(re.findall(r"^# TYPE (twolink_\w+) ", text, re.MULTILINE))
    shown = {name for name in shown if not name.endswith("_created")}
    assert shown == set(re.findall(r"`(twolink_\w+)", TEXT))


def test_the_fields_of_the_log_are_those_of_the_table() -> None:
    table = TEXT[TEXT.index("In JSON, a request has") : TEXT.index("and a message has")]
    named = {name for cell in re.findall(r"^\| (`.*?`) \|", table, re.MULTILINE) for name in re.findall(r"\w+", cell)}
    assert named == set(Answered.__struct_fields__)


@pytest.mark.parametrize("path", ["/", "/page/main.js", "/docs", "/health", "/ready"])
def test_what_needs_no_token(path: str) -> None:
    assert f"`{path.replace('main.js', '...')}`" in TEXT
    control = AccessControl(Settings("data", tokens=("secret",)))
    scope = {"headers": [(b"host", b"localhost")], "method": "GET", "path": path}
    control.check(scope)
    with pytest.raises(Refusal, match="token"):
        control.check({**scope, "path": "/metrics"})
