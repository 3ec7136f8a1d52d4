"""Pickling of Pinocchio's models with mimic joints: Pinocchio 4.1 forgets a part of each.

After pickling, such a joint states nvExtended = -1, and the next query writes outside its arrays: the process dies. The
joints are therefore built again, from their own type and axis.
"""

import re
from typing import Any

import numpy as np
import pinocchio as pin

_Mimic = tuple[int, int, str, tuple[float, ...], float, float]


def _mimics(model: pin.Model) -> list[_Mimic]:
    """Of each mimic joint: its index, the index of the joint it follows, its type, axis, multiplier and offset."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    found = []
    for index in model.mimicking_joints:
        joint = model.joints[index].extract()
        text = str(joint)
        kind = re.search(r"Mimicking joint type: (\w+)", text)
        followed = re.search(r"Mimicked joint id: (\d+)", text)
        if kind is None or followed is None:
            raise TypeError(f"Pinocchio describes a mimic joint as {text!r}")
        subspace = np.asarray(data.joints[index].S).ravel() / joint.scaling
        axis = tuple(float(x) for x in (subspace[:3] if np.any(subspace[:3]) else subspace[3:]))
        found.append((int(index), int(followed[1]), kind[1], axis, float(joint.scaling), float(joint.offset)))
    return found


def reduce_model(model: pin.Model) -> tuple[Any, ...]:
    """How a model is pickled, for `copyreg.pickle`."""
    plain = model.__reduce__()
    mimics = _mimics(model) if len(model.mimicking_joints) else []
    return (restore_model, (*plain[1:3], mimics)) if mimics else plain


def restore_model(arguments: tuple[Any, ...], state: Any, mimics: list[_Mimic]) -> pin.Model:
    """The model that `reduce_model` has taken apart."""
    model = pin.Model(*arguments)
    model.__setstate__(state)
    for index, followed, kind, axis, scaling, offset in mimics:
        leader = model.joints[followed]
        joint = getattr(pin, kind)(*([np.array(axis)] if kind.endswith("Unaligned") else []))
        joint.setIndexes(followed, leader.idx_q, leader.idx_v, leader.idx_vExtended)
        mimic = pin.JointModelMimic(joint, scaling, offset)
        mimic.setIndexes(index, leader.idx_q, leader.idx_v, model.idx_vExtendeds[index])
        model.joints[index] = pin.JointModel(mimic)
    return model
