"""The runs of a sweep: quantities that can vary, by name; and a grid, a list, or random samples of them."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from twolink.dynamics import load_robot
from twolink.dynamics.arguments import whole
from twolink.errors import SceneError, require_known
from twolink.io.text import kebab_case
from twolink.scenes import Scene
from twolink.scenes.parameters import PREFIX, Parameter, named_parameters, parameters_of

OF_VARIANTS = ("switch", "accuracy", "robot")


def named_quantities(scene: Scene, names: Iterable[str]) -> dict[str, Parameter]:
    """Quantities of a sweep by name: numbers of the scene (`scenes.parameters`), or what makes a variant of it.

    These are "effects.1" for an effect that is on or off, "accuracy", and "robot" for other robots under the same
    effects. Raises SceneError for an unknown name, code "unknown-parameter".
    """
    of_variants, names = _of_variants(scene), list(names)
    numbers = named_parameters(scene, [name for name in names if name not in of_variants], "vary", of_variants)
    known = of_variants | {number.name: number for number in numbers}
    return {name: known[name] for name in names}


def quantities(scene: Scene) -> dict[str, Parameter]:
    """All that can be varied, by name, without values of tables."""
    return parameters_of(scene) | _of_variants(scene)


def _of_variants(scene: Scene) -> dict[str, Parameter]:
    """Quantities that make another variant of the scene."""
    found = [Parameter("accuracy", "accuracy", math.nan, "rad or m", "accuracy asked for"),
             Parameter("robot", "robot", math.nan, "", "robot, from random_state(1, seed=0)")]  # fmt: skip
    for i, effect in enumerate(scene.effects):
        text = f"whether effect {i}, {kebab_case(type(effect).__name__)}, acts"
        found.append(Parameter(f"{PREFIX}{i}", "switch", math.nan, "1", text, entries=(i,)))
    return {one.name: one for one in found}


def as_values(asked: Parameter, values: Any) -> np.ndarray:
    """Values of a quantity as an array (n,): booleans for effects, names of robots, else floats. Raises SceneError."""
    array, got = np.asarray(values), f"got {values!r:.60}"
    if asked.kind == "switch":
        if array.dtype != bool or array.ndim != 1 or not array.size:
            raise _misfit(asked.name, f"expected true or false, {got}", "such as [False, True]")
        return array
    if asked.kind == "robot":
        if array.dtype.kind not in "UO" or array.ndim != 1 or not all(isinstance(x, str) for x in array.tolist()):
            raise _misfit(asked.name, f"expected names of robots, {got}", 'such as ["panda", "ur5"]')
        return array.astype(object)
    if array.dtype.kind not in "fiu" or array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise _misfit(asked.name, f"expected finite numbers (n,), {got}", "such as [0.5, 1.0, 1.5]")
    if asked.kind == "accuracy" and (array <= 0.0).any():
        raise _misfit(asked.name, f"expected numbers above 0, got {float(array.min()):g}", "such as [1e-3, 1e-6]")
    return np.asarray(array, dtype=float)


def _misfit(name: str, what: str, remedy: str) -> SceneError:
    """The error for values that a quantity cannot have."""
    return SceneError(what, where=f"vary[{name!r}]", argument="vary", remedy=remedy)


@dataclass(frozen=True, eq=False)
class RunInputs:
    """Runs of one variant of a scene, which differ in numbers.

    scene: without the effects that are off. accuracy: of all, None as in `simulate`. q (n, nq), v (n, nv): the starts.
    parameters: values (n,) by name, in the numbering of the variant's effects.
    """

    scene: Scene
    accuracy: float | None
    q: np.ndarray
    v: np.ndarray
    parameters: dict[str, np.ndarray]


class Variant(NamedTuple):
    """Settings that a group of runs shares: places of effects that are off, accuracy, and robot ("": the scene's)."""

    off: tuple[int, ...]
    accuracy: float | None
    robot: str

    def of(self, scene: Scene) -> Scene:
        """The scene without the effects that are off, and with the robot; the same object where nothing differs."""
        effects = [effect for place, effect in enumerate(scene.effects) if place not in self.off]
        if self.robot:
            base = load_robot(self.robot)
            q, v = base.random_state(1, seed=0)
            return Scene(base, q[0], v[0], effects, scene.duration, scene.title)
        return scene.with_effects(effects) if self.off else scene

    def renamed(self, name: str) -> str | None:
        """A parameter's name without the effects that are off; None for one of theirs."""
        if not name.startswith(PREFIX):
            return name
        place, _, path = name.removeprefix(PREFIX).partition(".")
        if int(place) in self.off:
            return None
        return f"{PREFIX}{int(place) - sum(other < int(place) for other in self.off)}.{path}"

    def inputs(self, own: Scene, quantities: Mapping[str, Parameter], values: Mapping[str, np.ndarray]) -> RunInputs:
        """The runs with these values (n,) by name. own: what `of` gives."""
        count = len(next(iter(values.values())))
        q, v = np.tile(own.q, (count, 1)), np.tile(own.v, (count, 1))
        parameters = {}
        for name, numbers in values.items():
            what = quantities[name]
            if what.kind in ("q", "v"):
                what.put(q, v, numbers)
            elif what.kind not in OF_VARIANTS and (new := self.renamed(name)) is not None:
                parameters[new] = numbers
        return RunInputs(own, self.accuracy, q, v, parameters)


RUN = "run"  # the dimension of lists and samples
SAMPLERS = ("random", "sobol", "latin-hypercube")
DESIGNS = ("grid", "list", *SAMPLERS)
MOST_DIMENSIONS = 30  # of a grid: NumPy has 64, and each is a folder in the paths of the store
Block = tuple[slice, ...]


@dataclass(frozen=True, eq=False)
class Design:
    """The runs of a sweep.

    kind: one of DESIGNS. quantities: what varies, by name. values (n,): of each; in a grid each has a dimension of its
    own, else all share the dimension "run". seed: of samples, else None.
    """

    kind: str
    quantities: dict[str, Parameter]
    values: dict[str, np.ndarray]
    seed: int | None = None

    @property
    def dims(self) -> tuple[str, ...]:
        """The names of the dimensions."""
        return tuple(self.values) if self.kind == "grid" else (RUN,)

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of runs along each dimension."""
        sizes = [len(numbers) for numbers in self.values.values()]
        return tuple(sizes) if self.kind == "grid" else (sizes[0],)

    @property
    def runs(self) -> int:
        """The number of runs."""
        return math.prod(self.shape)

    def in_block(self, block: Block) -> dict[str, np.ndarray]:
        """The values (n,) of each quantity in the runs of a block, in C order."""
        if self.kind != "grid":
            return {name: numbers[block[0]] for name, numbers in self.values.items()}
        axes = [numbers[part] for numbers, part in zip(self.values.values(), block, strict=True)]
        return {name: grid.ravel() for name, grid in zip(self.values, np.meshgrid(*axes, indexing="ij"), strict=True)}


def planned_runs(vary: Mapping[str, Any], kind: str, count: int | None) -> int:
    """The number of runs that are asked for, before any values are made. What is malformed counts as one."""
    if kind in SAMPLERS:
        return count or 1
    sizes = []
    for given in vary.values():
        numbers = given.get("range", ()) if isinstance(given, Mapping) else given
        last = numbers[-1] if isinstance(given, Mapping) and len(numbers) else len(numbers)
        sizes.append(max(1, int(last)) if math.isfinite(last) else 1)
    return math.prod(sizes) if kind == "grid" else max(sizes, default=1)


def make_design(scene: Scene, vary: Mapping[str, Any], kind: str, count: int | None, seed: int) -> Design:
    """The runs that are asked for.

    Parameters
    ----------
    scene : Scene
    vary : mapping
        Values by name, or {"range": [first, last, count]} for equally spaced ones; of samples {"uniform": [low, high]}
        or {"normal": [mean, standard deviation]}.
    kind : str
        "grid": all combinations. "list": the values at one position of all together. "random", "sobol" or
        "latin-hypercube": samples (`scipy.stats.qmc`).
    count, seed : int
        Of samples.

    Raises
    ------
    SceneError
        A name is unknown, or the values do not fit.
    """
    require_known(kind, DESIGNS, SceneError, "there is no design {!r}", argument="design")
    if not isinstance(vary, Mapping) or not vary:
        raise SceneError(f"expected values by name, got {vary!r:.60}", argument="vary",
                         remedy='such as {"q.elbow": [0.0, 0.5, 1.0]}')  # fmt: skip
    if kind == "grid" and len(vary) > MOST_DIMENSIONS:
        raise SceneError(f"a grid of {len(vary)} quantities", argument="vary",
                         remedy=f'up to {MOST_DIMENSIONS}, or design="list"')  # fmt: skip
    quantities = named_quantities(scene, map(str, vary))
    if kind in SAMPLERS:
        return Design(kind, quantities, _samples(quantities, vary, kind, count, seed), seed)
    if count is not None:
        raise SceneError(f"a {kind} has the number of runs that its values give", argument="count",
                         remedy='leave it out, or design="sobol"')  # fmt: skip
    values = {name: as_values(quantities[name], _range(name, given)) for name, given in vary.items()}
    for name, numbers in values.items():
        if kind == "grid" and len(np.unique(numbers)) < len(numbers):
            raise _misfit(name, "a value is there twice", "keep one")
    if kind == "list" and len({len(numbers) for numbers in values.values()}) > 1:
        sizes = {name: len(numbers) for name, numbers in values.items()}
        raise SceneError(f"a list needs as many values of each, got {sizes}", argument="vary",
                         remedy='give as many of each, or design="grid"')  # fmt: skip
    return Design(kind, quantities, values)


def _range(name: str, given: Any) -> Any:
    """Values as they are given, or those of a range."""
    if not isinstance(given, Mapping):
        return given
    first, last, count = _numbers(name, given, ("range",), 3)[1]
    if count != int(count) or not 1 <= count <= 1e9:
        raise _misfit(name, f"expected a number of values, got {count:g}", "such as 100")
    return np.linspace(first, last, int(count))


def _numbers(name: str, given: Any, kinds: tuple[str, ...], size: int) -> tuple[str, list[float]]:
    """The name and the numbers of a mapping of one entry. Raises SceneError."""
    if isinstance(given, Mapping) and len(given) == 1:
        kind, numbers = next(iter(given.items()))
        array = np.asarray(numbers)
        if kind in kinds and array.shape == (size,) and array.dtype.kind in "fiu" and np.isfinite(array).all():
            return kind, [float(x) for x in array]
    raise _misfit(name, f"expected {' or '.join(kinds)} with {size} numbers, got {given!r:.60}",
                  f"such as {{{kinds[0]!r}: {[0.0, 1.0, 100][:size]}}}")  # fmt: skip


def _samples(
    quantities: Mapping[str, Parameter], vary: Mapping[str, Any], kind: str, count: int | None, seed: int
) -> dict[str, np.ndarray]:
    """Samples (count,) of each quantity. More of them begin with the same ones, except in a Latin hypercube."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    count, seed = whole(count, "count", SceneError, "such as 1024", 1), whole(seed, "seed", SceneError)
    asked = {name: _numbers(name, given, ("uniform", "normal"), 2) for name, given in vary.items()}
    if kind == "random":
        unit = np.random.default_rng(seed).random((count, len(asked)))
    elif kind == "sobol":  # whole powers of 2 keep the balance, and scipy warns of other numbers
        unit = qmc.Sobol(len(asked), rng=seed).random_base2(max(0, math.ceil(math.log2(count))))[:count]
    else:
        unit = qmc.LatinHypercube(len(asked), rng=seed).random(count)
    values = {}
    for (name, (law, (a, b))), u in zip(asked.items(), unit.T, strict=True):
        if b < a if law == "uniform" else b < 0.0:
            raise _misfit(name, f"got {law} with {[a, b]}", "[low, high], or [mean, standard deviation]")
        tiny = 2.0**-54  # ndtri(0) is infinite
        numbers = a + (b - a) * u if law == "uniform" else a + b * ndtri(np.clip(u, tiny, 1.0 - tiny))
        if quantities[name].kind == "switch":
            raise _misfit(name, "an effect is on or off", 'give values: design="grid" or "list"')
        values[name] = as_values(quantities[name], numbers)
    return values


def block_shape(shape: tuple[int, ...], runs: int) -> tuple[int, ...]:
    """The shape of blocks of up to so many runs that tile an array of this shape; the last dimensions are filled."""
    sizes = [1] * len(shape)
    for i in reversed(range(len(shape))):
        sizes[i] = max(1, min(shape[i], runs))
        runs //= sizes[i]
        if sizes[i] < shape[i]:
            break
    return tuple(sizes)


def blocks(shape: tuple[int, ...], sizes: tuple[int, ...]) -> Iterator[Block]:
    """The blocks of these sizes that tile an array, in C order."""
    for index in np.ndindex(*(-(-n // size) for n, size in zip(shape, sizes, strict=True))):
        yield tuple(slice(i * size, min(n, (i + 1) * size)) for i, size, n in zip(index, sizes, shape, strict=True))
