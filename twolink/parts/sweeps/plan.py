"""The plan of a sweep: what is run, in which blocks, and the record by which a store knows its sweep and its origin."""

import contextlib
import dataclasses
import functools
import hashlib
import inspect
import io
import json
import math
import pickle
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from twolink._version import __version__
from twolink.contact.choice import choose_contact_method
from twolink.dynamics import Robot, load_robot
from twolink.dynamics.arguments import whole
from twolink.dynamics.robot_record import robot_notes
from twolink.effects.effect import Effect, plain
from twolink.effects.policies import Policy
from twolink.errors import RobotError, SceneError
from twolink.io.fingerprints import model_digest, processor, versions
from twolink.parts.sweeps.design import OF_VARIANTS, RUN, Block, Design, block_shape
from twolink.parts.sweeps.outputs import OutputVariable, Request, check_names, coordinates, function_of, variables
from twolink.parts.sweeps.runs import SweepTask, ways
from twolink.robots.catalogue import catalogue_names
from twolink.robots.collisions import read_solids
from twolink.scenes import Scene
from twolink.simulation.scene_run import ACCURACY

LIBRARIES = ("pin", "numpy", "scipy", "zarr", "xarray")
BATCH, SINGLE = 4096, 64  # runs of a block at most
LEAST_BATCH = 64  # fewer do not fill the vectors of a batch
PARTS = 32  # blocks at least, so that workers end together
MAX_NUMBERS = 20_000_000  # that a block keeps
LONGEST_NAME = 200  # bytes
WAYS_FROM = 4096  # runs of which the ways are told


def origin() -> dict[str, Any]:
    """Versions, machine (kind of processor and system, no names) and the time (UTC)."""
    return {"twolink": __version__, "versions": versions(LIBRARIES), "machine": f"{platform.machine()}, {processor()}",
            "system": f"{platform.system()} {platform.release()}, Python {platform.python_version()}",
            "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())}  # fmt: skip


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """A sweep: the scene, its runs, and what is kept of them. sizes: of a block along each dimension."""

    scene: Scene
    design: Design
    request: Request
    sizes: tuple[int, ...]

    @functools.cached_property
    def variables(self) -> list[OutputVariable]:
        """The variables of the store; `status` is the last."""
        return variables(self.scene.robot, self.request)

    @functools.cached_property
    def record(self) -> dict[str, Any]:
        """A record of all that the results depend on beside the values that vary, as plain data."""
        request, design = self.request, self.design
        stepped = choose_contact_method(self.scene).method == "stepped"
        accuracy = request.accuracy or (None if stepped else ACCURACY)
        return {"scene": scene_record(self.scene), "design": design.kind, "vary": sorted(design.values),
                "seed": design.seed, "duration": request.duration, "accuracy": accuracy,
                "outputs": list(request.outputs), "functions": [_content(function_of(x)) for x in request.functions],
                "t_eval": list(request.t_eval), "verify": request.verify}  # fmt: skip

    @functools.cached_property
    def robots(self) -> dict[str, str]:
        """Digests of the robots that vary and are files, by path."""
        found = {}
        for name in set(self.design.values.get("robot", ())) - set(catalogue_names()):
            with contextlib.suppress(RobotError):  # its runs say what is wrong with it
                found[name] = _robot_content(load_robot(name))
        return found

    @functools.cached_property
    def _scene(self) -> tuple[str, bytes]:
        content = pickle.dumps(self.scene)
        return _digest(content, repr(sorted(self.robots.items()))), content

    def task(self, block: Block) -> SweepTask:
        """The runs of a block."""
        return SweepTask(*self._scene, self.request, self.design.quantities, self.design.in_block(block))

    def ordered(self, names: Sequence[str]) -> "SweepPlan":
        """The plan with the dimensions of its grid in the order of these names."""
        values, sizes = self.design.values, dict(zip(self.design.values, self.sizes, strict=True))
        design = dataclasses.replace(self.design, values={name: values[name] for name in names})
        return dataclasses.replace(self, design=design, sizes=tuple(sizes[name] for name in names))

    @functools.cached_property
    def ways(self) -> list[str]:
        """The ways in which the first runs are solved, with the reasons."""
        return _ways(self.scene, self.request, self.design, WAYS_FROM)


def make_plan(scene: Scene, design: Design, request: Request, chunk: int | None) -> SweepPlan:
    """The plan. chunk: the number of runs of a block; by default what keeps workers busy. Raises SceneError."""
    if "robot" in design.quantities:
        _check_robots(design, request)
    for name in design.values:
        if "/" in name or name.startswith("__") or len(name.encode()) > LONGEST_NAME:  # of a folder
            raise SceneError("a store cannot have an array of this name", where=f"vary[{name[:80]!r}]", argument="vary",
                             remedy="rename the joint or link in the URDF")  # fmt: skip
    kept = variables(scene.robot, request)
    check_names([*design.values, RUN, *coordinates(scene.robot, request), *(variable.name for variable in kept)])
    if chunk is None:
        in_batches = all(text.startswith("in batches") for text in _ways(scene, request, design, 1))
        least, most = (LEAST_BATCH, BATCH) if in_batches else (1, SINGLE)
        numbers = sum(math.prod(variable.shape) for variable in kept)
        chunk = max(1, min(most, max(least, -(-design.runs // PARTS)), MAX_NUMBERS // numbers))
    else:
        chunk = whole(chunk, "chunk", SceneError, "such as 1000", 1)
    effects = tuple(map(_pinned, scene.effects))
    if any(pinned is not effect for pinned, effect in zip(effects, scene.effects, strict=True)):
        scene = scene.with_effects(effects)
    return SweepPlan(scene, design, request, block_shape(design.shape, chunk))


def _check_robots(design: Design, request: Request) -> None:
    """Require that what varies, and what is kept, is the same for all robots. Raises SceneError."""
    odd = [name for name, what in design.quantities.items() if what.kind not in OF_VARIANTS]
    if odd:
        raise SceneError(f"{odd[0]} belongs to one robot", where="vary['robot']", argument="vary",
                         remedy="vary the accuracy or effects beside robots")  # fmt: skip
    kept = {"final", "samples"} & set(request.outputs)
    if kept:
        raise SceneError(f"{min(kept)} has another size for each robot", argument="outputs",
                         remedy='such as ["cost", "energy"]')  # fmt: skip


def _ways(scene: Scene, request: Request, design: Design, runs: int) -> list[str]:
    first = tuple(slice(0, n) for n in block_shape(design.shape, runs))
    return ways(scene, request, design.quantities, design.in_block(first))


def scene_record(scene: Scene) -> dict[str, Any]:
    """A scene as plain data: its robot's notes and content, its state and its effects.

    Functions are named by their module, with a digest of their text and of the object whose methods they are. Raises
    SceneError for a function that has no name to be found by.
    """
    notes = robot_notes(scene.base) | {"content": _robot_content(scene.base)}
    return {"robot": notes, "q": scene.q.tolist(), "v": scene.v.tolist(),
            "effects": json.loads(json.dumps([_effect_record(effect) for effect in scene.effects]))}  # fmt: skip


def _robot_content(robot: Robot) -> str:
    """A digest of what moves and touches."""
    visuals = robot.visuals
    shapes = read_solids(visuals.text, visuals.collision_meshes, ""), sorted(map(sorted, visuals.srdf.apart))
    return _digest(model_digest(robot.model, whole=True), repr(shapes))


def _pinned(effect: Effect) -> Effect:
    """The effect, whose network must not become another one while it is run."""
    if isinstance(effect, Policy):
        return effect.pinned()
    inner = getattr(effect, "of", None)
    return msgspec.structs.replace(effect, of=_pinned(inner)) if isinstance(inner, Effect) else effect


def _effect_record(effect: Effect) -> dict[str, Any]:
    """An effect as plain data, with the text of its class where that is not of twolink."""
    table: dict[str, Any] = msgspec.to_builtins(effect, enc_hook=_named)
    if not type(effect).__module__.startswith("twolink."):
        table["class"] = _named(type(effect))
    if isinstance(inner := getattr(effect, "of", None), Effect):
        table["of"] = _effect_record(inner)
    return table


def _named(value: Any) -> Any:
    """NumPy's numbers as Python's, and functions by module and name, with a digest of what they are."""
    name = getattr(value, "__qualname__", "")
    if callable(value):
        if not name or "<" in name:
            raise SceneError("a function in an effect has no name that workers find it by", argument="scene",
                             remedy="define it in a module")  # fmt: skip
        return {"name": f"{value.__module__}:{name}", "content": _content(value)}
    return plain(value)


def _content(function: Any) -> str:
    """A digest of the text of a function or class; of a method that of its object's class, and the object's state."""
    own = function.__self__ if inspect.ismethod(function) else None
    try:
        text = inspect.getsource(function if own is None else type(own))
    except (OSError, TypeError):  # typed in, or compiled
        text = ""
    state = io.BytesIO()
    _Pickler(state).dump(own)
    return _digest(text, state.getvalue())


class _Pickler(pickle.Pickler):
    """A pickler of sets in an order of their own: Python's is another one in each process."""

    def persistent_id(self, value: Any) -> list[str] | None:
        """The elements of a set in order, in place of it."""
        return sorted(map(repr, value)) if isinstance(value, set | frozenset) else None


def _digest(*parts: str | bytes) -> str:
    """A digest of texts and bytes."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def difference(old: Any, new: Any, path: str = "") -> str:
    """The first difference of two records, as text; empty where they are equal."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        keys = [*old, *(key for key in new if key not in old)]
        pairs = [(f"{path}.{key}".lstrip("."), old.get(key), new.get(key)) for key in keys]
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = [(f"{path}[{i}]", a, b) for i, (a, b) in enumerate(zip(old, new, strict=True))]
    else:
        return "" if old == new else f"{path} was {old!r:.80} and is now {new!r:.80}"
    return next((text for name, a, b in pairs if (text := difference(a, b, name))), "")
