"""Laws that are traced give the motion of their Python; what is not known stays Python, or is an error by name."""

import itertools
import math
import random
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import twolink as tl
from twolink.errors import ControllerError, SceneError
from twolink.loop import sampled_loop

E = tl.effects
GAIN = np.array([[2.0, -0.5], [0.3, 1.0]])


def how(scene: tl.Scene) -> str:
    return next(note for note in tl.explain(scene).notes if "its law is" in note)


def arm(law: Any, period: float = 0.01, **fields: Any) -> tl.Scene:
    return tl.Scene(tl.load_robot("two_link"), effects=[E.Gravity(), E.Controller(law, period, **fields)], duration=0.7)


def pd(_: float, y: Any, state: Any) -> Any:
    return 30.0 * (0.3 - y.q) - 8.0 * y.v, state


def cascaded(t: float, y: Any, state: Any) -> Any:
    total, ticks = state
    error = 0.4 * np.sin(t) - y.q
    total = np.clip(total + 0.01 * error, -0.5, 0.5)
    return np.clip(GAIN @ (30.0 * error + 10.0 * total) - 5.0 * y.v, -40.0, [40.0, 30.0]), (total, ticks + 1)


def predictive(_: float, y: Any, state: Any) -> Any:
    """The first of ten steps ahead, by the gradient of their cost."""
    plan = state
    for _ in range(3):
        ahead = y.q + 0.01 * np.arange(1, 11)[:, None] * y.v + np.cumsum(plan, axis=0) * 1e-4
        plan = plan - 2.0 * np.flip(np.cumsum(np.flip(ahead - 0.3, axis=0), axis=0), axis=0) * 0.1
    return np.where(np.abs(plan[0]) > 20.0, 20.0 * np.sign(plan[0]), plan[0]) - 3.0 * y.v, plan


STATES = {pd: None, cascaded: (np.zeros(2), 0), predictive: np.zeros((10, 2))}


@pytest.mark.parametrize("law", STATES)
@pytest.mark.parametrize("fields", [{}, {"delay": 0.004}, {"limit": {"shoulder": 9.0, "elbow": 3.0}},
                                    {"offset": 0.003}, {"hold": "first"}])  # fmt: skip
@pytest.mark.parametrize("method", ["auto", "rk4"])
def test_a_traced_law_gives_the_motion_of_its_python(law: Any, fields: dict[str, Any], method: str) -> None:
    scenes = [arm(law, state=STATES[law], traced=one, **fields) for one in (False, True)]
    python, program = (tl.simulate(one, accuracy=1e-6, method=method) for one in scenes)
    assert "traced" in how(scenes[1])
    assert "called" in how(scenes[0])
    np.testing.assert_allclose(program.q, python.q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(program.error, python.error, rtol=1e-3)
    assert program.cost.steps == python.cost.steps
    between = np.linspace(0.0, 0.7, 333)
    np.testing.assert_allclose(program.at(between)[0], python.at(between)[0], rtol=0, atol=1e-11)


def test_many_ticks_in_a_call_have_the_bits_of_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = arm(cascaded, 0.001, state=STATES[cascaded])
    many = tl.simulate(scene)
    monkeypatch.setattr(sampled_loop, "many_ticks", lambda *_: None)
    one = tl.simulate(scene)
    np.testing.assert_array_equal(many.q, one.q)
    np.testing.assert_array_equal(many.error, one.error)
    assert many.events == one.events


def mixing(_: float, y: Any, state: Any) -> Any:
    return -5.0 * np.round(y.q, 3), state


def test_rows_are_found_out_or_asked_for() -> None:
    run = tl.simulate(arm(mixing))
    assert "in rows" in how(arm(mixing))
    np.testing.assert_array_equal(run.q, tl.simulate(arm(lambda t, y, s: mixing(t, y, s)[: 2 * bool(len(y.q))])).q)

    def integral(_: float, y: Any, state: Any) -> Any:
        total, count = state
        total = total + 0.01 * np.round(0.3 - y.q, 4)
        return 30.0 * (0.3 - y.q) + 20.0 * total - 8.0 * y.v, (total, count + 1)

    rows, each = (arm(law, state=(np.zeros(2), 0)) for law in (integral, lambda t, y, s: integral(t, y, s)[: len(y.q)]))
    assert "in rows" in how(rows)
    np.testing.assert_array_equal(tl.simulate(rows).q, tl.simulate(each).q)
    assert "for each" in how(arm(integral, state=(0.0, 0)))  # whose number becomes an array
    insisted = arm(lambda _, y, s: (-5.0 * y.q[:, ::-1], s), vectorized=True)
    alone = arm(lambda _, y, s: (-5.0 * y.q[::-1], s), traced=False)
    np.testing.assert_array_equal(tl.simulate(insisted).q, tl.simulate(alone).q)
    with pytest.raises(ControllerError) as refused:
        tl.simulate(arm(lambda _, y, s: (y.q - y.q.mean(axis=0), s), vectorized=True))
    assert refused.value.code == "law-differs"
    with pytest.raises(ControllerError) as refused:
        tl.simulate(arm(lambda _, y, s: (y.q[0], s), vectorized=True))
    assert "in each of 3 rows" in refused.value.remedy


def test_what_cannot_be_traced_is_named_where_it_is_asked_for() -> None:
    def branches(_: float, y: Any, state: Any) -> Any:
        return (y.q if y.q[0] > 0.0 else y.v), state

    with pytest.raises(SceneError) as refused:
        tl.simulate(arm(branches, traced=True))
    assert refused.value.code == "law-not-traced"
    assert "a branch on a value" in str(refused.value)
    assert "a branch on a value" in how(arm(branches))


def test_a_law_that_shows_to_differ_is_called_for_each_from_the_start() -> None:
    def late(t: float, y: Any, state: Any) -> Any:
        return -5.0 * y.q / (t - 0.32), state  # Python's 0.0 raises, NumPy's does not

    assert "traced" in how(arm(late))
    with pytest.raises(ControllerError) as raised:
        tl.simulate(arm(late))
    assert raised.value.code == "controller-failed"
    assert raised.value.data["t"] == pytest.approx(0.32)
    assert "answered otherwise" in how(arm(late))


PURE = (
    "e = np.sin(e) * {c} + y.v", "e = np.where(e > {c}, e, {c} * y.v)", "e = np.clip(e, -{c}, {c})", "e = GAIN @ e",
    "e = np.minimum(e, y.q[::-1])", "e = np.concatenate([e[1:], e[:1]])", "e = e / (1.0 + y.v**2)", "e = -e[...]",
    "e = abs(e) - np.tanh(t) * e.sum()", "e = np.maximum(e, np.hypot(y.q, {c}))", "e = np.stack([e[1], y.q[0] * {c}])",
    "e = e * isinstance(y.q, np.ndarray)", "e = e + 0.1 * np.sign(y.v) * ((y.q > -{c}) & (e < {c}))",
    "e = e if len(y.q) == 2 else 2.0 * e", "e = e - state; state = 0.9 * state + 0.1 * y.q",
    "e = e.copy().clip(max={c})", "e = np.stack([e, y.v]).T @ np.array([{c}, 0.1])",
    "state = np.where(t > {c}, e, state)",
)  # fmt: skip
PYTHON = (
    "e = e * 0.5 if y.q[0] > {c} else e", "e = e * (1.0 if t < {c} else 0.5)", "e = e * (float(y.q[0]) > {c})",
    "e = np.array(e); e[0] = {c}", "y.q[0] += {c}; e = e + y.q", "e = -e; e *= 2.0", "e = e * int(10 * t)",
    "e = e * (t // 0.1)", "e = e * math.sin(t)", "e = e * np.round(t, 1)", "e = np.array(sorted(e))",
    "e = e if np.any(y.q > {c}) else -e", "e = e * max(e[0], {c})", "e = e * np.interp(t, [0, 1], [0, {c}])",
    "e = e * (y.v[0] != 0.0) if t else e", "e = e + np.nan_to_num(np.sqrt(y.q))", "e = np.array([e[1], y.q[0] * {c}])",
    "\n    try:\n        e = e * float(y.q[0])\n    except Exception:\n        pass",
)  # fmt: skip
REMEMBERS = (
    "e = e + np.random.normal()", "e = e + random.random()", "e = e + time.perf_counter() % 1.0",
    "global COUNT; COUNT += 1; e = e * (COUNT % 7)", "BOX.append(t); e = e / len(BOX)", "e = e + next(DRAWS)",
    "law.k = getattr(law, 'k', 0) + 1; e = e * (law.k % 5)", "box[0] = box[0] + 1; e = e * (box[0] % 9)",
    "ARRAY[0] = e[0]; e = e + ARRAY", "ARRAY[:] = ARRAY + 1.0; e = e + ARRAY",
    "np.add(ARRAY, 1.0, ARRAY); e = e + ARRAY",
    "np.add.at(ARRAY, 0, 1.0); e = e + ARRAY", "e = e + np.array([c.pop() for c in [BOX or [1.0]]])",
    "BOX.__setitem__(0, BOX[0] + 1.0); e = e + BOX[0]",
    "law.__dict__.update(k=law.__dict__.get('k', 0) + 1); e = e * law.k",
)  # fmt: skip


def random_law(number: int) -> tuple[Callable[[], Any], str]:
    """A law of random statements, made anew at each call, and its kind."""
    rng = random.Random(number)
    kind = rng.choice(("pure", "python", "remembers"))
    lines = [rng.choice(PURE) for _ in range(rng.randint(2, 6))]
    if kind != "pure":
        lines.insert(rng.randrange(len(lines)), rng.choice(PYTHON if kind == "python" else REMEMBERS))
    body = "\n    ".join(line.replace("{c}", repr(round(rng.uniform(0.05, 0.9), 3))) for line in lines)
    source = (f"def law(t, y, state{', box=[0]' * ('box' in body)}):\n    e = {rng.uniform(1, 20)} * (0.3 - y.q)\n"
              f"    {body}\n    return np.clip(e, -30.0, 30.0) - 0.5 * y.v, state")  # fmt: skip

    def made() -> Any:
        names = {"np": np, "math": math, "time": time, "random": random, "GAIN": GAIN, "BOX": [1.0], "COUNT": 0,
                 "ARRAY": np.zeros(2), "DRAWS": itertools.count(), "__name__": "a_users_module"}  # fmt: skip
        exec(source, names)
        return names["law"]

    return made, kind


@pytest.mark.parametrize("first", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(60, 300, 60))])
def test_no_law_is_traced_wrongly(first: int) -> None:
    kinds: dict[str, int] = {}
    for number in range(first, first + 60):
        made, kind = random_law(number)
        scene = arm(made(), state=np.zeros(2))
        with np.errstate(all="ignore"):
            way = "traced" if "law is traced" in how(scene) else "python"
            kinds[f"{kind} {way}"] = kinds.get(f"{kind} {way}", 0) + 1
            if kind == "remembers":
                assert way == "python", number
                continue
            run = tl.simulate(scene, verify=False)
            truth = tl.simulate(arm(made(), state=np.zeros(2), traced=False), verify=False)
        np.testing.assert_allclose(run.q, truth.q, rtol=0, atol=1e-9, err_msg=str(number))
    assert kinds["pure traced"] > 0.8 * (kinds["pure traced"] + kinds.get("pure python", 0))
    assert kinds["remembers python"] > 10
