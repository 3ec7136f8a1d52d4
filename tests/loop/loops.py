"""Loops with exact solutions, step by step in rational or long arithmetic; and a slider of 1 kg to close them on."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import twolink as tl

SLIDER = """<robot name="slider"><link name="base"/><link name="cart"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="rail" type="prismatic">
<parent link="base"/><child link="cart"/><axis xyz="1 0 0"/><limit lower="-99" upper="99" effort="9" velocity="9"/>
</joint></robot>"""


def slider() -> tl.Robot:
    return tl.load_robot(SLIDER)


def pd(_: float, y: Any, state: Any) -> tuple[Any, Any]:
    """A law for the slider."""
    return -4.0 * y.q - 2.0 * y.v, state


def exact_pd(
    q: Fraction, period: Fraction, delay: Fraction, times: Sequence[Fraction]
) -> list[tuple[Fraction, Fraction]]:
    """(q, v) of the slider with the law `pd`."""
    return exact_slider(lambda q, v: -4 * q - 2 * v, q, period, delay, times)


def exact_slider(
    law: Callable[[Fraction, Fraction], Fraction],
    q: Fraction,
    period: Fraction,
    delay: Fraction,
    times: Sequence[Fraction],
) -> list[tuple[Fraction, Fraction]]:
    """(q, v) of q'' = u(t) from rest at times: u_k = law(q, v) at k period acts from k period + delay on."""
    t, v, u = Fraction(0), Fraction(0), Fraction(0)
    waiting: list[tuple[Fraction, Fraction]] = []
    tick, out = Fraction(0), []
    for end in times:
        while t < end or tick <= end:
            following = min([end, tick, *(at for at, _ in waiting)])
            h, t = following - t, following
            q, v = q + h * v + h * h / 2 * u, v + h * u
            if t == tick:
                waiting.append((t + delay, law(q, v)))
                tick += period
            while waiting and waiting[0][0] == t:
                u = waiting.pop(0)[1]
            if t == end and tick > end:
                break
        out.append((q, v))
    return out
