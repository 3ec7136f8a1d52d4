"""What the service counts, in Prometheus's text format."""

from __future__ import annotations

import os

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.multiprocess import MultiProcessCollector

MEDIA_TYPE = "text/plain; version=0.0.4"
SHARED_FOLDER = "PROMETHEUS_MULTIPROC_DIR"  # prometheus_client's own: set where several processes count together
_BUCKETS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.05, 0.2, 1.0, 5.0)


class Metrics:
    """Counters of one process; with several, each process's answer adds up all of them."""

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        self._requests = Counter("twolink_requests", "Requests answered", ["route", "status"], registry=self._registry)
        self._seconds = Histogram(
            "twolink_request_seconds", "Seconds to answer", ["route"], buckets=_BUCKETS, registry=self._registry
        )
        self._states = Counter("twolink_states", "States answered by queries", registry=self._registry)
        self._jobs = Counter("twolink_jobs", "Jobs ended", ["kind", "state"], registry=self._registry)
        self._deaths = Counter("twolink_worker_deaths", "Worker processes that died", registry=self._registry)
        self._running = Gauge(
            "twolink_jobs_running", "Jobs running", registry=self._registry, multiprocess_mode="livesum"
        )
        self._pairs: dict[tuple[str, int], tuple[Counter, Histogram]] = {}

    def answered(self, route: str, status: int, seconds: float) -> None:
        """Count a request."""
        pair = self._pairs.get((route, status))
        if pair is None:  # labels() takes as long as a whole query does
            pair = self._requests.labels(route, str(status)), self._seconds.labels(route)
            self._pairs[route, status] = pair
        pair[0].inc()
        pair[1].observe(seconds)

    def states(self, count: int) -> None:
        """Count states that a query answered."""
        self._states.inc(count)

    def job_started(self) -> None:
        """Count a job that has begun."""
        self._running.inc()

    def job_ended(self, kind: str, state: str) -> None:
        """Count a job that has ended."""
        self._running.dec()
        self._jobs.labels(kind, state).inc()

    def worker_died(self) -> None:
        """Count a worker process that died."""
        self._deaths.inc()

    def text(self) -> bytes:
        """All counters."""
        if not os.environ.get(SHARED_FOLDER):
            return generate_latest(self._registry)
        shared = CollectorRegistry()
        MultiProcessCollector(shared)  # type: ignore[no-untyped-call]
        return generate_latest(shared)
