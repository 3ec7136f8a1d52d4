"""Environments of Gymnasium (Towers et al. 2024) from a scene, one world or many in a batch."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from twolink.dynamics.arguments import positive, whole
from twolink.errors import MissingExtraError, SceneError
from twolink.integrate.motion.state import Array
from twolink.integrate.solver import first_tolerance
from twolink.integrate.steps.perturbation import NO_PERTURBATION
from twolink.integrate.steps.step_map import step_map
from twolink.integrate.steps.stepping import BLOCK, FINE, advance, start_state
from twolink.robots.joint_layout import NO_LIMIT
from twolink.scenes import Scene
from twolink.scenes.scene import accuracy_of
from twolink.simulation.motion_error import METHOD
from twolink.simulation.sampling import duration_for
from twolink.simulation.stepwise import Saved, Simulation, State, equations_held, one, start_of, state_of

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode
except ImportError:
    raise MissingExtraError(
        "Gymnasium is not installed", where="twolink.gym", remedy="pip install 'twolink[gym]'"
    ) from None

Seen = Callable[[State], Array]
Reward = Callable[[State, Array], float]
Start = Callable[[np.random.Generator], tuple[Array, Array]]
EFFORT = 1.0  # N m or N, of joints without a limit of effort


class Task:
    """A task in a scene: its observations, actions and reward.

    Parameters
    ----------
    scene : Scene
        Its controllers are called at their ticks, and actions add to them, see `tl.Simulation`.
    reward : callable
        (state, action) -> float, of the state at the end of a period.
    period : float
        Between actions, s; the torques are constant in between.
    observe : callable, optional
        state -> array; by default q and v.
    terminated : callable, optional
        state -> bool, whether the episode ends there, as it does at an event that ends the motion; by default it does
        not before the scene's duration.
    start : callable, optional
        random generator -> (q, v); by default the scene's own start.
    limit : array_like (nv,), optional
        Of the torques, N m or N; by default the URDF's efforts, and 1 where there is none.
    accuracy : float
        Which the steps are chosen for, rad or m.
    """

    def __init__(
        self,
        scene: Scene,
        reward: Reward,
        *,
        period: float = 0.02,
        observe: Seen | None = None,
        terminated: Callable[[State], bool] | None = None,
        start: Start | None = None,
        limit: Any = None,
        accuracy: float = 1e-6,
    ) -> None:
        duration_for(scene, None)  # raises SceneError for what is no scene
        self.scene, self.reward, self.accuracy = scene, reward, accuracy_of(accuracy)
        self.period = positive(period, "period", SceneError, "a time in s")
        self.observe = observe or (lambda state: np.concatenate([state.q, state.v]))
        self.terminated = terminated or (lambda _: False)
        self.start = start or (lambda _: (scene.q, scene.v))
        effort, nv = np.asarray(scene.robot.model.effortLimit), scene.robot.nv
        self.limit = np.where((effort > 0.0) & (effort < NO_LIMIT), effort, EFFORT)
        if limit is not None:
            self.limit = one("limit", np.full(nv, limit) if np.ndim(limit) == 0 else limit, nv)
            positive(self.limit.min(initial=np.inf) if nv else 1.0, "limit", SceneError, "largest torques, N m or N")
        self.actions = gymnasium.spaces.Box(-self.limit, self.limit, dtype=np.float64)

    def observations(self, state: State) -> gymnasium.spaces.Box:
        """The space of what is seen, by a state."""
        return gymnasium.spaces.Box(-np.inf, np.inf, np.shape(self.observe(state)), dtype=np.float64)

    def begin(self, random: np.random.Generator, options: Mapping[str, Any] | None) -> tuple[Any, Any]:
        """q and v of a start: those of the options, others as the task begins. Raises SceneError for other options."""
        wrong = set(options or {}) - {"q", "v"}
        if wrong:
            raise SceneError(f"unknown option {min(wrong)!r}", argument="options", remedy="q and v of the start")
        chosen = dict(zip("qv", self.start(random), strict=True)) | dict(options or {})
        return chosen["q"], chosen["v"]

    def torques(self, action: Any, *worlds: int) -> Array:
        """The torques of actions (nv,), or (worlds, nv), within their limits. Raises SceneError for another shape."""
        given, shape = np.asarray(action, dtype=float), (*worlds, *self.limit.shape)
        if given.shape != shape:
            raise SceneError(f"expected shape {shape}, got {given.shape}", argument="action",
                             remedy="a torque of each degree of freedom")  # fmt: skip
        tau: Array = np.minimum(np.maximum(given, -self.limit), self.limit)
        return tau

    def outcome(self, state: State, action: Array) -> tuple[Array, float, bool, bool]:
        """The observation of a state, the reward, whether it is terminal, and whether the time is up."""
        seen = np.asarray(self.observe(state), dtype=float)
        late = state.t >= self.scene.duration - 0.5 * self.period
        return seen, float(self.reward(state, action)), bool(self.terminated(state)), bool(late)


class Environment(gymnasium.Env[Array, Array]):
    """A scene as an environment of Gymnasium. Takes what `Task` takes.

    Parameters
    ----------
    contact : {"located", "stepped"}, optional
        How contacts, stops and dry friction are computed, as of `tl.Simulation`; contacts of a quadruped are stepped.
    step : float
        The longest step of stepped contacts, s.

    Examples
    --------
    >>> import twolink as tl
    >>> from twolink.gym import Environment
    >>> env = Environment(tl.load_scene("arm-swing"), lambda state, action: -abs(state.q[0]))
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    """

    def __init__(
        self, scene: Scene, reward: Reward, *, contact: str | None = None, step: float = 1e-3, **task: Any
    ) -> None:
        self.task = Task(scene, reward, **task)
        self.simulation = Simulation(scene, accuracy=self.task.accuracy, contact=contact, step=step)
        self._repeats = all(one.sampled is None for one in scene.effects)  # laws may remember what no save has
        self._begun: tuple[Array, Array, Saved] | None = None  # the last start
        self.action_space, self.observation_space = self.task.actions, self.task.observations(self.simulation.state)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode. options: q and v of its start."""
        super().reset(seed=seed)
        q, v = (np.array(one, dtype=float) for one in self.task.begin(self.np_random, options))
        if self._begun and np.array_equal(self._begun[0], q) and np.array_equal(self._begun[1], v):
            self.simulation.restore(self._begun[2])  # contacts and events are not prepared again
        else:
            self.simulation.set_state(q, v, t=0.0)
            self._begun = (q, v, self.simulation.save()) if self._repeats else None
        return np.asarray(self.task.observe(self.simulation.state), dtype=float), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Act for a period. An event that ends the motion is terminal."""
        tau = self.task.torques(action)
        state = self.simulation.step(self.task.period, tau)
        seen, reward, terminated, truncated = self.task.outcome(state, tau)
        return seen, reward, terminated or self.simulation.ended, truncated, {"t": state.t}


class VectorEnvironment(gymnasium.vector.VectorEnv[Array, Array, Array]):
    """Many worlds of a scene as a vector environment: a batch of compiled steps. Takes what `Task` takes.

    A world that has ended begins its next episode with the next step, whose action it ignores.

    Parameters
    ----------
    num_envs : int
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 Gymnasium's

    def __init__(self, scene: Scene, reward: Reward, num_envs: int, **task: Any) -> None:
        self.task, self.num_envs = Task(scene, reward, **task), whole(num_envs, "num_envs", SceneError, "such as 8", 1)
        for i, effect in enumerate(scene.effects):
            if effect.sampled is not None:
                raise SceneError("a sampled controller is not called in a batch", where=f"effects[{i}]",
                                 remedy="several Environment", code="not-step-by-step")  # fmt: skip
        equations, self._torques = equations_held(*scene.with_held_torques())
        if equations.constraints is not None or equations.has_events:
            raise SceneError("worlds with loops or events are not solved in a batch", where="effects",
                             remedy="several Environment", code="not-step-by-step")  # fmt: skip
        equations.require(0.0, max(1, math.ceil(scene.duration / self.task.period - 0.5 - 1e-9)) * self.task.period)
        self._map = step_map(equations, METHOD)
        x = np.repeat(equations.start[:, None], num_envs, axis=1)
        self._state, self._limit = start_state(self._map, x, 0.0, scene.duration,
                                               first_tolerance(METHOD, self.task.accuracy))  # fmt: skip
        self._begin, self._ended = self._state[:, 0].copy(), np.zeros(num_envs, dtype=bool)
        self._random = [np.random.default_rng() for _ in range(num_envs)]
        batch = gymnasium.vector.utils.batch_space
        self.single_action_space = self.task.actions
        self.single_observation_space = self.task.observations(self._seen(0))
        self.action_space = batch(self.single_action_space, num_envs)
        self.observation_space = batch(self.single_observation_space, num_envs)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode in every world. seed: of the first world, the next ones have seed + 1, ...; or one of each.

        options: q and v of the start of all.
        """
        if seed is not None:
            seeds = seed + np.arange(self.num_envs) if np.ndim(seed) == 0 else seed
            self._random = [gymnasium.utils.seeding.np_random(one if one is None else int(one))[0] for one in seeds]
        if len(self._random) != self.num_envs:
            raise SceneError(f"{len(self._random)} seeds for {self.num_envs} worlds", argument="seed",
                             remedy="one, or one of each")  # fmt: skip
        self._restart(np.arange(self.num_envs), options)
        return np.array([self.task.observe(self._seen(i)) for i in range(self.num_envs)], dtype=float), {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Act for a period in every world."""
        state, rows, tau = self._state, self._map.rows, self.task.torques(actions, self.num_envs)
        again = np.flatnonzero(self._ended)
        state[self._torques], state[rows.end] = tau.T, state[rows.time] + self.task.period
        state[rows.end, again], before = state[rows.time, again], state[rows.step].copy()
        lost = np.zeros(self.num_envs, dtype=bool)
        for block in advance(self._map, state, self._limit, BLOCK, (NO_PERTURBATION,)):
            lost[block.worlds[block.outcome != FINE]] = True
        state[rows.step] = np.fmax(state[rows.step], before)  # a period ends steps, and does not make them smaller
        self._restart(again)
        out = [self.task.outcome(self._seen(i), tau[i]) for i in range(self.num_envs)]
        seen, rewards, terminated, truncated = (np.array(part) for part in zip(*out, strict=True))
        rewards[again], terminated[again], truncated[again] = 0.0, False, False
        self._ended = terminated | truncated | lost
        return seen, rewards, terminated | lost, truncated, {"lost": lost}

    def _restart(self, worlds: Array, options: Mapping[str, Any] | None = None) -> None:
        equations = self._map.equations
        for i in worlds:
            q, v = self.task.begin(self._random[i], options)
            self._state[:, i] = self._begin
            self._state[: equations.space.size, i] = start_of(self.task.scene, equations, q, v)
        self._ended[worlds] = False

    def _seen(self, i: int) -> State:
        x = self._state[:, i]
        return state_of(self.task.scene, self._map.equations, float(x[self._map.rows.time]), x)
