"""A slider of 1 kg with a stop and dry friction under a sampled law, from event to event in arithmetic of 60 digits."""

import decimal
from collections.abc import Callable, Sequence
from decimal import Decimal

REST = Decimal("1e-25")  # m/s: a bounce so slow is the last one
Law = Callable[[Decimal, Decimal, Decimal], Decimal]


def exact_switched_slider(
    law: Law,
    start: tuple[str, str],
    period: str,
    times: Sequence[str],
    *,
    stop: str = "inf",
    restitution: str = "0",
    friction: str = "0",
) -> list[tuple[Decimal, Decimal]]:
    """(q, v) at times of q'' = u_k - friction sign(v), q <= stop; u_k = law(t, q, v) holds from k period on."""
    with decimal.localcontext(decimal.Context(prec=60)):
        t, q, v = Decimal(0), *map(Decimal, start)
        end, e, f, h, k, u = Decimal(stop), Decimal(restitution), Decimal(friction), Decimal(period), 0, Decimal(0)
        out = []
        for wanted in map(Decimal, times):
            while t < wanted or (t == wanted and k * h <= t):
                if t == k * h:
                    u, k = law(t, q, v), k + 1
                until = min(wanted, k * h)
                while t < until:
                    drive = u - f.copy_sign(v if v else u)
                    if v == 0 and (abs(u) <= f or (q == end and u >= 0)):
                        drive = Decimal(0)
                    s = until - t
                    hit = _first(q - end, v, drive) if end.is_finite() and not (q == end and v <= 0 >= drive) else None
                    still = -v / drive if f and v * drive < 0 else None
                    first = min(x for x in (s, hit, still) if x is not None)
                    q, v, t = q + first * v + first * first * drive / 2, v + first * drive, t + first
                    if first == hit:
                        q, v = end, -e * v if e * v > REST else Decimal(0)
                    elif first == still:
                        v = Decimal(0)
            out.append((q, v))
        return out


def _first(gap: Decimal, v: Decimal, a: Decimal) -> Decimal | None:
    """When gap + v s + a s^2 / 2 first passes 0 from below after s = 0."""
    if a == 0:
        return -gap / v if v > 0 and gap else None
    if gap == 0:
        found = [-2 * v / a]
    else:
        under = v * v - 2 * a * gap
        found = [] if under < 0 else [(-v - under.sqrt()) / a, (-v + under.sqrt()) / a]
    later = [s for s in found if s > 0]
    return min(later) if later else None
