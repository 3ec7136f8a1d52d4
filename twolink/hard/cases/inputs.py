"""Inputs that jump, torques that overflow a double, and odd durations."""

from __future__ import annotations

import itertools

import numpy as np

from twolink.hard import truths
from twolink.hard.case import Motion, Truth, at

PULSE = (5.0, 5.001, 1000.0)  # from, to [s], N: on 1 kg, 1 m/s afterwards
STEPS_T, STEPS_F = (0.0, 0.3, 0.7, 1.1), (1.0, -2.0, 5.0, 0.0)


def _pulse(t: np.ndarray) -> np.ndarray:
    begin, end, force = PULSE
    inside, length = np.clip(t - begin, 0.0, end - begin), end - begin
    return np.asarray(force * inside**2 / 2 + force * length * np.maximum(t - end, 0.0))[:, None]


def _steps(t: np.ndarray) -> np.ndarray:
    out = np.zeros(len(t))
    position = speed = 0.0
    edges = (*STEPS_T, np.inf)
    for force, (begin, end) in zip(STEPS_F, itertools.pairwise(edges), strict=True):
        here = (t >= begin) & (t <= end)
        s = t[here] - begin
        out[here] = position + speed * s + force * s * s / 2
        if np.isfinite(end):
            length = end - begin
            position, speed = position + speed * length + force * length**2 / 2, speed + force * length
    return out[:, None]


CASES = (
    Motion(
        name="short-pulse", group="inputs",
        title="A push of a millisecond after five seconds of rest",
        why="Nothing moves for 5 s, so that an adaptive step grows until it steps across the push and never sees it. A "
            "step of fixed size sees it, but as long as its own steps are.",
        scene="short-pulse", duration=10.0, samples=20.0,
        truth=Truth("closed form: parabola and straight line", truths.of_configuration(_pulse), "error of q [m]"),
        settings=at(1e-3, 1e-6, 1e-9), peers=("scipy", "mujoco"),
    ),
    Motion(
        name="torque-steps", group="inputs",
        title="A force that jumps",
        why="Every jump is a step's error of first order for whoever steps across it.",
        scene="torque-steps", duration=2.0, samples=50.0,
        truth=Truth("closed form: parabolas end to end", truths.of_configuration(_steps), "error of q [m]"),
        settings=at(1e-3, 1e-6, 1e-9), peers=("scipy", "mujoco"),
    ),
    Motion(
        name="overflowing-torque", group="inputs",
        title="A torque of 1e308 N m",
        why="The velocity overflows a double within a second: Inf and NaN follow, and NaN compares as false.",
        scene="overflowing-torque", duration=10.0, peers=("scipy", "mujoco", "drake"),
        truth=Truth("there is none: an error that says so must come", truths.of_configuration(
            lambda t: np.full((len(t), 2), np.inf)), doubt=0.0),
        settings=at(1e-3, 1e-6, 1e-9), may_refuse=1.0,
    ),
    Motion(
        name="picosecond", group="inputs",
        title="A duration of 1e-12 s",
        why="What grows steps, or counts them, from the duration may divide by what rounds to nothing.",
        scene="pendulum", duration=1e-12, samples=1e12, peers=(),
        truth=Truth("closed form, in 60 digits", truths.of_configuration(
            lambda t: truths.swing(np.pi / 2, 9.81**0.5)(t)[:, None] - np.pi / 2), doubt=1e-16),
        settings=at(1e-3, 1e-6, 1e-9),
    ),
    Motion(
        name="thirty-years", group="inputs",
        title="A duration of 1e9 s",
        why="30 years of a pendulum are 4e8 periods: an answer or an error, and within reasonable time.",
        scene="pendulum", duration=1e9, samples=1e-8, peers=(),
        truth=Truth("closed form, in 60 digits", truths.of_configuration(
            lambda t: truths.swing(np.pi / 2, 9.81**0.5)(t)[:, None] - np.pi / 2), doubt=1e-16),
        settings=at(1e-3, 1e-6, 1e-9), may_refuse=1.0,
    ),
)  # fmt: skip
