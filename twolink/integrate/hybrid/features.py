"""Contacts of pairs of bodies at features: which are hit, and how one follows another over an edge."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from twolink.integrate.hybrid.consistency import NEAR
from twolink.integrate.hybrid.impacts import contact_touch, onto_contact
from twolink.integrate.hybrid.locating import Guard
from twolink.integrate.hybrid.snapshot import Snapshot
from twolink.integrate.hybrid.state import RunState, no_single_point

REACHES = (NEAR, 1e-6, 1e-3)  # m: of features that are hit; wider for states beside a motion


def pair_guards(run: RunState) -> Iterator[Guard]:
    """Pairs of which further features may touch."""
    covered: dict[int, set[int]] = {p: set() for p in range(len(run.system.pairs))}
    closed = {(p, one.number) for i, p, one in run.features if run.mode.contacts[i] != "free"}
    for p, number in closed:
        covered[p].add(number)
    for p, group in run.touching() if closed else ():
        if any((p, one.number) in closed for one in group):
            covered[p] |= {one.number for one in group}
    for p, without in covered.items():
        yield Guard(("meet", p), partial(_least_gap, run, p, without), partial(_meet, p), run.t, of="distance")


def _least_gap(run: RunState, p: int, without: set[int], s: Snapshot) -> Any:
    """The smallest gap of what may touch of a pair, m."""
    return run.system.pairs[p].gaps(run.motion(s), without)


def single_point(run: RunState, i: int, s: Snapshot) -> Any:
    """The value that is above 0 while a contact touches at one point; None where it always does."""
    return run.system.contacts[i].single(run.motion(s))


def _meet(p: int, run: RunState) -> None:
    """Features of a pair that touch: the one that is approached fastest is hit, and what touches beside it."""
    run.fired.discard(("meet", p))  # what is smallest after this is another gap
    for reach in REACHES:
        run.add_touching(reach)
        own = [i for i, pair, _ in run.features if pair == p and run.mode.contacts[i] == "free"]
        if own:
            break
        if any(pair == p for pair, _ in run.touching()):  # it comes to where another feature touches already
            return
    else:
        raise no_single_point(run.system.pairs[p].name, run.t)
    rates = run.evaluate().contacts[:, 1, 0]
    i = min(own, key=lambda i: float(rates[i]))
    run.x[: run.system.nq] = onto_contact(run, i)
    run.apply_impact(contact_touch(run, i))
    run.resolve_mode()


def pass_edge(i: int, run: RunState) -> None:
    """A corner that leaves a face, or the end of an edge: the features beside it that touch become contacts."""
    snapshot, name = run.evaluate(), run.system.contacts[i].name
    closed = [k for k, _, _ in run.features if run.mode.contacts[k] != "free"]
    gone = {i, *(k for k in closed if np.asarray(single_point(run, k, snapshot)).item() <= NEAR)}
    run.passed |= {(p, one.number) for k, p, one in run.features if k in gone}
    run.keep_contacts([k for k in range(len(run.system.contacts)) if k not in gone])
    known = len(run.events)
    run.resolve_mode()
    touches = any(run.mode.contacts[k] != "free" and run.system.contacts[k].name == name for k, _, _ in run.features)
    run.events[known:] = [event for event in run.events[known:] if event.what != name]
    run.note("edge" if touches else "leave", name)
