"""Scenes with contacts and states that are wrong, for the native library: run as a process, which a crash ends.

    python -m tests.native.fuzzing_contacts SEED COUNT

Prints, by entry, how many calls were refused and how many were fine.
"""

import ctypes
import sys
from typing import Any

import numpy as np

import twolink as tl
from tests.effects.bodies import free_bodies
from tests.native.fuzzing import LONG, NUMBERS, WHOLE, Calls
from twolink.contact.compiled import parts_of
from twolink.contact.solver import stepper_of
from twolink.contact.steps import Memory
from twolink.native.contact import Parts, StepPlan, _Told
from twolink.native.library import OUTCOMES

E = tl.effects


def scenes() -> list[Parts]:
    """Boxes on each other; an arm with a stop and dry friction; balls and a cylinder around it on rough ground."""
    names, robot = "abc", free_bodies("a", "b", "c", inertia=0.01)
    stacked, apart = ([x for k in range(3) for x in (0.0, 0.0, 0.1 + h * k, 0.0, 0.0, 0.0, 1.0)] for h in (0.2, 0.5))
    boxes = E.Contact(("self", "ground"), 0.5, restitution=0.3, shapes={name: (E.Box((0.2,) * 3),) for name in names})
    shapes = {"a": (E.Sphere(0.1),), "b": (E.Capsule(0.1, 0.1),), "c": (E.Cylinder(0.1, 0.1),)}
    arm = tl.load_robot("two_link")
    rough = E.HeightField(((0.0, 0.1), (0.0, 0.0), (0.1, 0.0)), (0.4, 0.6), (-0.4, -0.3, 0.0))
    rounds = E.Contact(("ground", ("a", rough), ("a", "b"), ("a", "c")), 0.5, shapes=shapes)
    joint, tip = arm.joints[0].name, arm.frame_names[-1]
    on_arm = [E.Gravity(), E.JointStops({joint: (-1.0, 1.0)}), E.DryFriction({joint: 0.1}),
              E.JointDamping({joint: 0.1}), E.Contact(((tip, E.Plane(height=-5.0)),), 0.5,
                                                      shapes={tip: (E.Sphere(0.1),)})]  # fmt: skip
    made = [tl.Scene(robot, stacked, effects=[E.Gravity(), boxes]), tl.Scene(robot, apart, effects=[rounds]),
            tl.Scene(arm, effects=on_arm)]  # fmt: skip
    steppers = [stepper_of(scene) for scene in made]
    return [parts_of(one.bodies, one.detector, one.joints, one.laws, one.loops) for one in steppers]


class ContactFuzzer(Calls):
    """Sound scenes, of which some numbers are made wrong."""

    refused, counting = range(1, len(OUTCOMES)), ("tl_contact_run",)

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.scenes = scenes()

    def once(self) -> None:
        """A scene with some wrong sizes, indices or numbers, and steps of it."""
        parts, random = self.scenes[int(self.random.integers(len(self.scenes)))], self.random
        sizes, whole = np.array(parts.sizes, dtype=np.int32), np.array(parts.whole, dtype=np.int32)
        numbers, lengths = np.array(parts.numbers, dtype=float), [len(parts.whole), len(parts.numbers)]
        programs = [None if one is None else one.require_handle().value for one in (parts.program, parts.loops)]
        kind = random.integers(6)
        if kind == 0:
            sizes[random.integers(len(sizes))] = random.choice(WHOLE)
        elif kind == 1:
            for at in random.integers(len(whole), size=2):
                whole[at] = random.choice([*WHOLE, 3, 4])
        elif kind in (2, 3):
            for at in random.integers(len(numbers), size=random.integers(1, 4)):
                numbers[at] = random.choice(NUMBERS)
        elif kind == 4:  # a length above the true one tells the library to read what is not there
            lengths[random.integers(2)] = int(random.choice([-1, 0, 1, 5, -(2**63)]))
        values = [sizes.ctypes.data, lengths[0], whole.ctypes.data, lengths[1], numbers.ctypes.data, *programs, 0,
                  None, int(random.integers(2))]  # fmt: skip
        if random.random() < 0.1:
            values[int(random.choice([0, 2, 4, 5, 6]))] = None
        made = ctypes.c_void_p()
        self.note("tl_contact_new", code := self.c.tl_contact_new(*values, ctypes.byref(made)))
        if code == 0:
            for _ in range(3):
                self.run(made.value, *(int(size) for size in sizes[1:4]))
            self.c.tl_contact_free(made)

    def run(self, scene: Any, nq: int, nv: int, m: int) -> None:
        """States, memories, lengths and pieces of every kind."""
        random, count, known = self.random, int(self.random.integers(1, 6)), int(self.random.integers(0, 5))
        q, v, change = random.normal(size=nq), random.normal(size=nv), random.normal(size=2 * nv)
        plan = StepPlan(count, random.normal(size=(2, m)))
        plan.t[:], plan.h[:], plan.piece[:], plan.mark[:] = (
            np.arange(count) * 0.01,
            0.01,
            *random.integers(0, 2, (2, count)),
        )
        for array in (q, v, change, plan.t, plan.h, plan.numbers):
            if random.random() < 0.3 and array.size:
                array.flat[random.integers(array.size)] = random.choice([*NUMBERS, 1e5])
        keys = np.sort(random.choice([*LONG[:8], 2**38, 3 * 2**38, 2**39 + 1], size=known, replace=False))
        forces, marks = random.normal(size=(known, 3)), random.integers(0, 2, (2, known))
        if random.random() < 0.2:
            plan.piece[random.integers(count)] = random.choice(LONG)
            keys = keys[::-1].copy()
        memory = Memory.of(keys, forces, marks[0], marks[1], change, *random.choice(NUMBERS, size=2)).words
        start, told = np.concatenate([q, v, memory]), _Told()
        # A plan of more steps or pieces than it has tells the library to read what is not there.
        counts = [int(random.integers(-1, 2)), count, start.size]
        if random.random() < 0.1:
            counts[int(random.integers(3))] = int(random.choice([-1, 0, -(2**63), 2**62]))
        pointers = [scene, plan.arguments[0], start.ctypes.data, ctypes.addressof(told)]
        if random.random() < 0.1:
            pointers[int(random.integers(4))] = None
        scene, at, begin, out = pointers
        sizes = (*plan.arguments[1:], *counts[:2])
        self.note("tl_contact_run", int(self.c.tl_contact_run(scene, at, *sizes, begin, counts[2], out)))

    def nothing(self) -> None:
        """Null where a scene is expected."""
        self.c.tl_contact_free(None)


if __name__ == "__main__":
    ContactFuzzer(int(sys.argv[1])).tell(int(sys.argv[2]))
