"""Counts of the service, in Prometheus's text format."""

from collections.abc import Callable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest

MEDIA_TYPE = "text/plain; version=0.0.4"
_BUCKETS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.05, 0.2, 1.0, 5.0)
_WAIT_BUCKETS = (0.01, 0.1, 1.0, 10.0, 60.0, 600.0, 3600.0)


class Metrics:
    """The counters of a service. Jobs are counted by kind and state, requests by route and status."""

    def __init__(self) -> None:
        self._registry = registry = CollectorRegistry()
        self.states = Counter("twolink_states", "States answered by queries", registry=registry)
        self.jobs = Counter("twolink_jobs", "Jobs ended", ["kind", "state"], registry=registry)
        self.job_wait = Histogram(
            "twolink_job_wait_seconds", "Seconds that jobs waited", buckets=_WAIT_BUCKETS, registry=registry
        )
        self.worker_deaths = Counter("twolink_worker_deaths", "Worker processes that died", registry=registry)
        self.loop_lag = Histogram(
            "twolink_loop_lag_seconds", "Seconds by which the event loop is late", buckets=_BUCKETS, registry=registry
        )
        ProcessCollector(registry=registry)  # memory, CPU time, open files of the service's own process
        self._requests = Counter("twolink_requests", "Requests answered", ["route", "status"], registry=registry)
        self._seconds = Histogram(
            "twolink_request_seconds", "Seconds to answer", ["route"], buckets=_BUCKETS, registry=registry
        )
        self._labelled: dict[tuple[str, int], tuple[Counter, Histogram]] = {}

    def gauge(self, name: str, about: str, value: Callable[[], float]) -> None:
        """Show a value as it is when somebody asks."""
        Gauge(name, about, registry=self._registry).set_function(value)

    def answered(self, route: str, status: int, seconds: float) -> None:
        """Count a request."""
        pair = self._labelled.get((route, status))
        if pair is None:  # labels() takes as long as a whole query does
            pair = self._requests.labels(route, str(status)), self._seconds.labels(route)
            self._labelled[route, status] = pair
        pair[0].inc()
        pair[1].observe(seconds)

    def text(self) -> bytes:
        """All counters."""
        return generate_latest(self._registry)
