"""Numbers of more digits than a double's: sums of doubles along the last axis of an array, largest first."""

import decimal
import math
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
SIGNIFICANT = {1: 17, 2: 32, 3: 48}  # digits that numbers of so many doubles hold
_EXACT = decimal.Context(prec=120)


def decimals(x: Array) -> Array:
    """Numbers (..., parts) as decimal.Decimal (...), with the digits that they hold."""
    context = decimal.Context(prec=SIGNIFICANT[x.shape[-1]])

    def of(parts: list[float]) -> decimal.Decimal:
        total = decimal.Decimal(0)
        for part in parts:
            total = _EXACT.add(total, decimal.Decimal(part))
        return context.plus(total)

    out = np.empty(x.shape[:-1], dtype=object)
    out.ravel()[:] = [of(parts) for parts in x.reshape(-1, x.shape[-1]).tolist()]
    return out


def difference(a: Array, b: Array) -> Array:
    """a - b of numbers (..., parts), rounded once to doubles (...)."""
    each = np.concatenate([a, -b], axis=-1)
    flat = [math.fsum(parts) if np.isfinite(parts).all() else math.nan for parts in each.reshape(-1, each.shape[-1])]
    return np.array(flat).reshape(each.shape[:-1])
