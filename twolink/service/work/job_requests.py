"""The bodies of requests about scenes, and of requests for jobs."""

import functools
import hashlib
from typing import Annotated, Literal

import msgspec

from twolink.io.fingerprints import code_key, files_digest
from twolink.robots.catalogue import our_urdfs
from twolink.scenes.file_format import SceneFile
from twolink.service.problems import decode_unique

Positive = Annotated[float, msgspec.Meta(gt=0)]
Wait = Annotated[float, msgspec.Meta(ge=0, le=30)]


class SceneRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """scene: the name of a bundled scene, or a scene file's content, its robot by id."""

    scene: str | SceneFile


class RunRequest(SceneRequest, frozen=True, forbid_unknown_fields=True):
    """duration: simulated seconds (the scene's own when left out). t_eval, samples_per_second: as of `tl.simulate`."""

    duration: Positive | None = None
    t_eval: Annotated[list[float], msgspec.Meta(min_length=1)] | None = None
    samples_per_second: Positive = 200.0

    def samples(self, seconds: float) -> float:
        """The number of samples of a run of so many seconds."""
        return seconds * self.samples_per_second if self.t_eval is None else len(self.t_eval)


class ExplainRequest(RunRequest, frozen=True, forbid_unknown_fields=True):
    """As `tl.explain`: accuracy in rad or m."""

    accuracy: Positive = 1e-6
    method: str = "auto"
    contact: Literal["located", "stepped"] | None = None


class SimulationRequest(ExplainRequest, frozen=True, forbid_unknown_fields=True):
    """As `tl.simulate`. wait: seconds to wait for the answer, before a job's state is sent instead."""

    verify: bool = True
    precision: Literal["auto", "double", "extended", "quad"] = "auto"
    tolerance: Positive | None = None
    step: Positive | None = None
    wait: Wait = 2.0


class LinearizationRequest(SceneRequest, frozen=True, forbid_unknown_fields=True):
    """As `tl.linearize`: the state, the scene's own where it is left out."""

    q: list[float] | None = None
    v: list[float] | None = None


class SensitivityRequest(RunRequest, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """As `tl.sensitivities`. wait: as of simulations."""

    wrt: Annotated[list[str], msgspec.Meta(min_length=1, max_length=50)]
    accuracy: Positive = 1e-6
    samples_per_second: Positive = 50.0
    wait: Wait = 2.0


class IdentificationRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """As `tl.identify`. robot: an id. data: the text of a CSV file, as `twolink identify` takes it. wait: as above."""

    robot: str
    data: str
    parameters: Annotated[list[str], msgspec.Meta(max_length=500)] | None = None
    method: Literal["weighted", "ordinary", "robust", "total"] = "weighted"
    confidence: Annotated[float, msgspec.Meta(gt=0, lt=1)] = 0.95
    wait: Wait = 2.0


class StudyRequest(RunRequest, frozen=True, forbid_unknown_fields=True):
    """As `tl.accuracy_study`. wait: as of simulations."""

    methods: Annotated[list[str], msgspec.Meta(max_length=50)] | None = None
    tolerances: Annotated[list[Positive], msgspec.Meta(max_length=50)] | None = None
    samples_per_second: Positive = 50.0
    repeats: Annotated[int, msgspec.Meta(ge=1, le=50)] = 7
    budget: Annotated[float, msgspec.Meta(gt=0, le=60)] = 1.0
    wait: Wait = 0.0


class SweepRequest(RunRequest, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """As `tl.sweep`. wait: as of simulations.

    vary: by name values, or {"range": [first, last, count]}; of samples {"uniform": [low, high]} or {"normal": [mean,
    standard deviation]}. outputs: final, samples, events, energy, cost.
    """

    vary: Annotated[dict[str, list[float | bool | str] | dict[str, list[float]]], msgspec.Meta(min_length=1)]
    accuracy: Positive = 1e-6
    design: Literal["grid", "list", "random", "sobol", "latin-hypercube"] = "grid"
    count: Annotated[int, msgspec.Meta(ge=1)] | None = None
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    outputs: Annotated[tuple[str, ...], msgspec.Meta(max_length=50)] = ("final",)
    verify: bool = True
    wait: Wait = 0.0

    def samples(self, seconds: float) -> float:
        """The number of samples of a run of so many seconds that are kept."""
        return super().samples(seconds) if "samples" in self.outputs else 0.0


Request = SimulationRequest | StudyRequest | SensitivityRequest | IdentificationRequest | SweepRequest
REQUESTS: dict[str, type[Request]] = {
    "simulation": SimulationRequest,
    "study": StudyRequest,
    "sensitivity": SensitivityRequest,
    "identification": IdentificationRequest,
    "sweep": SweepRequest,
}  # by the kind of the job


class JobRequest(msgspec.Struct, frozen=True):
    """A request for a job as the service keeps it. content: its JSON without `wait`, fields in order.

    key: the id of the job, which depends on the content alone and on what computes its result (`version_key`).
    """

    key: str
    wait: float
    content: bytes


@functools.cache
def version_key() -> str:
    """A digest of what computes results: our code, scenes and robots, and the versions of libraries."""
    return code_key() + files_digest(our_urdfs().glob("*.urdf"))


def prepare(*, kind: str, body: bytes) -> JobRequest:
    """Check the body of a request for a job. Raises what `decode_unique` raises."""
    request = decode_unique(body, REQUESTS[kind])
    fields = msgspec.to_builtins(request)
    del fields["wait"]
    content = msgspec.json.encode(fields, order="sorted")
    digest = hashlib.sha256(version_key().encode() + content).hexdigest()
    return JobRequest(f"{kind}-{digest[:20]}", request.wait, content)
