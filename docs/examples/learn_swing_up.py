"""Learning to swing a pendulum up with a weak motor: the cross-entropy method on worlds in a batch.

A policy is five weights, u = limit tanh(w . f(q, v)). Each generation plays a normal distribution of policies, one a
world; the best tenth give the next one its mean and spread (Szita, Lorincz 2006, Neural Computation 18(12), 2936-2941).
"""

import numpy as np

import twolink as tl
from twolink.gym import VectorEnvironment

LIMIT, SPEED = 8.0, 8.0  # N m: a quarter of what holds the arm straight out; rad/s
WORLDS, KEPT, GENERATIONS = 96, 12, 40


def reward(state, _):
    """The height of the tip, from -1 to 1."""
    return np.sin(state.q[0])


def start(random):
    """Somewhere near the bottom."""
    return random.uniform(-np.pi / 2 - 1.0, -np.pi / 2 + 1.0, 1), random.uniform(-1.0, 1.0, 1)


def environment(worlds: int) -> VectorEnvironment:
    """The paper's arm with a locked elbow, for 10 s; an action holds for 50 ms."""
    scene = tl.Scene(tl.load_robot("two_link", lock={"elbow": 0.0}), effects=[tl.effects.Gravity()], duration=10.0)
    return VectorEnvironment(scene, reward, worlds, period=0.05, limit=LIMIT, start=start, accuracy=1e-3)


def features(seen: np.ndarray) -> np.ndarray:
    """f (worlds, 5) of what is seen (worlds, 2): two near the top, three elsewhere."""
    q, v = seen.T
    s, c, v = np.sin(q), np.cos(q), v / SPEED
    near = np.exp(8.0 * (s - 1.0))
    return np.stack([near * c, near * v, *((1.0 - near) * v * [np.ones_like(s), s, v * v])], axis=1)


def returns(env: VectorEnvironment, weights: np.ndarray, seed: int) -> np.ndarray:
    """The mean reward of an episode of policies (worlds, 5)."""
    seen, _ = env.reset(seed=seed)
    total, steps = np.zeros(env.num_envs), 0
    while True:
        seen, rewards, _, truncated, _ = env.step(LIMIT * np.tanh((features(seen) * weights).sum(axis=1))[:, None])
        total, steps = total + rewards, steps + 1
        if truncated.any():
            return total / steps


def learn(seed: int = 0) -> np.ndarray:
    """The mean of the last generation (5,)."""
    random, env = np.random.default_rng(seed), environment(WORLDS)
    mean, spread = np.zeros(5), np.full(5, 5.0)
    for generation in range(GENERATIONS):
        weights = random.normal(mean, spread, (WORLDS, 5))
        best = weights[np.argsort(-returns(env, weights, 1000 * generation))[:KEPT]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 1.0 / (1 + generation)
    return mean


def judged(weights: np.ndarray) -> np.ndarray:
    """Returns from starts that no learning has seen."""
    return returns(environment(50), np.tile(weights, (50, 1)), seed=10**6)


if __name__ == "__main__":
    learned = learn()
    print("mean height before:", judged(np.zeros(5)).mean(), " after:", judged(learned).mean(), " weights:", learned)
