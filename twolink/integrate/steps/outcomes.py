"""Blocks of attempted steps, what became of each world in them, and the error of one that cannot go on."""

from typing import NamedTuple

import numpy as np

from twolink.errors import AccuracyError
from twolink.integrate.motion.causes import cause
from twolink.integrate.motion.state import Array
from twolink.integrate.steps.failures import failure, is_hopeless
from twolink.integrate.steps.step_map import StepMap

SINGULAR = 0.1  # relative: singular values of constraint rows below it are those near a singular position
SMALLEST_STEP = 1e-60  # s: of steps at t = 0, where any step changes the time
PACE_FROM = 10_000  # steps after which the pace so far is taken for the pace to the end
STUCK = 10  # limits of steps as short as the last one that would be left
FINE, NOT_FINITE, COLLAPSED, TOO_MANY = range(4)  # what became of a world
CODES = ("", "not-finite", "steps-collapsed", "too-many-steps")  # of failures, by outcome


class Block(NamedTuple):
    """Attempted steps of some worlds.

    worlds (w,): their numbers. states (k + 1, rows, w): state arrays from before the first step to after the last. t
    (k + 1, w): their times. outcome (w,): FINE, or why the world cannot go on.
    """

    worlds: Array
    states: Array
    t: Array
    outcome: Array


def outcome_of(step_map: StepMap, state: Array, start: Array, limit: int) -> Array:
    """Outcome of each world since its start: FINE, or why it cannot go on."""
    rows, space = step_map.rows, step_map.equations.space
    t, end, tried = state[rows.time], state[rows.end], state[rows.accepted] + state[rows.rejected]
    outcome = np.full(len(t), FINE)
    left = t < end
    if tried.max() > min(PACE_FROM, limit):
        late = tried > PACE_FROM
        outcome[left & ((late & is_hopeless(tried, limit, t, start, end)) | (tried > limit))] = TOO_MANY
        outcome[left & late & (end - t > STUCK * limit * state[rows.step])] = COLLAPSED
    outcome[left & (t + np.fmax(state[rows.step] - SMALLEST_STEP, 0.0) <= t)] = COLLAPSED
    outcome[~np.isfinite(state[: space.size]).all(axis=0)] = NOT_FINITE
    return outcome


def failure_of(step_map: StepMap, block: Block, limit: int) -> AccuracyError:
    """The error of the first world of a block."""
    t, outcome = block.t[:, 0], int(block.outcome[0])
    if outcome == NOT_FINITE:
        finite = np.isfinite(block.states[:, : step_map.equations.space.size, 0]).all(axis=1)
        last = float(t[max(0, int(np.argmin(finite)) - 1)])
        if step_map.method.adaptive:
            state = block.states[int(np.argmin(finite)), : step_map.equations.space.size, 0]
            return failure("not-finite", last, cause(step_map.equations, last, state))
        return failure("step-too-large", last, step=float(block.states[0, step_map.rows.step, 0]))
    constraints, space = step_map.equations.constraints, step_map.equations.space
    if outcome == COLLAPSED and constraints is not None:
        rows = constraints.jacobian_at(block.states[-1, : space.nq, 0], constraints.kept)
        sizes = np.linalg.svd(rows * np.array(constraints.scales)[:, None], compute_uv=False)
        if sizes[-1] < SINGULAR * sizes[0]:
            return failure("loops-singular", float(t[-1]))
    why = cause(step_map.equations, float(t[-1]), block.states[-1, : space.size, 0])
    return failure(CODES[outcome], float(t[-1]), why, **({"limit": limit} if outcome == TOO_MANY else {}))
