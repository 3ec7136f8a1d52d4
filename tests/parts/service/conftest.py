"""One running service for the tests that need no special one."""

from collections.abc import Iterator

import pytest

import twolink as tl
from tests.parts.service.page_driver import Page
from tests.parts.service.serving import Served, serving
from tests.show.browser import Browser
from twolink.parts.service.client import Client


@pytest.fixture
def anyio_backend() -> str:
    """What runs tests that are coroutines and marked so."""
    return "asyncio"


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    quotas = ("--quota", "load_seconds=60", "--quota", "disk_mb=600")
    with serving(tmp_path_factory.mktemp("service"), *quotas) as running:
        yield running


@pytest.fixture
def http(served: Served) -> Served:
    return served


@pytest.fixture
def client(served: Served) -> Iterator[Client]:
    made = tl.connect(served.url)
    yield made
    made.close()


@pytest.fixture
def page(served: Served, browser: Browser) -> Iterator[Page]:
    """The service's page. Afterwards: nothing was asked of others, and no script has failed."""
    opened = Page(browser, served.url)
    yield opened
    assert opened.outside() == []
    assert opened.faults() == []
