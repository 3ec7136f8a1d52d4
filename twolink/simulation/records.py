"""A run as plain data: what the command line prints as JSON and the service answers."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from twolink.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from twolink.simulation.energy_balance import EnergyBalance


def run_record(run: Trajectory) -> dict[str, Any]:
    """The summary of a run as numbers, texts, lists and dictionaries.

    Parameters
    ----------
    run : Trajectory

    Returns
    -------
    dict
        robot, joints (names); duration [s], samples (a count); error (the largest error bar, rad or m; None when the
        run is not verified), bound ("verified", "estimated" or ""), accuracy,
        trusted_until [s]; energy_drift: the range of the energy [J]; q, v at the end;
        cost: the fields of `Cost`, or None; events: dictionaries with the fields of `Event`; interrupted.
        contacts: of stepped contacts `Trajectory.contact_record`.
        q_precise, v_precise: q and v at the end as texts with all digits, of runs in higher precision only.
    """
    record = {
        "robot": run.robot.name,
        "joints": list(run.robot.joint_names),
        "duration": float(run.t[-1]),
        "samples": len(run.t),
        "error": None if run.error is None else float(run.error.max()),
        "bound": run.bound,
        "accuracy": run.accuracy,
        "trusted_until": run.trusted_until,
        "energy_drift": float(np.ptp(run.energy)),
        "q": run.q[-1].tolist(),
        "v": run.v[-1].tolist(),
        "cost": None if run.cost is None else dataclasses.asdict(run.cost),
        "events": [
            {**dataclasses.asdict(event), "t": float(event.t), "energy": float(event.energy)} for event in run.events
        ],
        "interrupted": run.interrupted,
    }
    if run.contact_record is not None:
        record["contacts"] = run.contact_record
    if run.precise is not None:  # as texts, because readers of JSON take numbers as doubles
        digits = [str(x) for x in run.precise[-1]]
        record |= {"q_precise": digits[: run.robot.nq], "v_precise": digits[run.robot.nq :]}
    return record


def balance_record(balance: EnergyBalance) -> dict[str, Any]:
    """The energy balance of a whole run as numbers, J.

    Parameters
    ----------
    balance : EnergyBalance

    Returns
    -------
    dict
        work: of each effect, by its name; stored: at the start and at the end; lost: in impacts and releases; residual:
        the largest at any sample.
    """
    return {
        "work": {name: float(work[-1]) for name, work in balance.work.items()},
        "stored": [float(balance.stored[0]), float(balance.stored[-1])],
        "lost": float(balance.lost[-1]),
        "residual": float(np.abs(balance.residual).max()),
    }
