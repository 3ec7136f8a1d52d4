"""Contact forces of a run by pair of bodies, with slips and impulses."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from twolink.errors import SceneError, require_known


class PairImpulses(NamedTuple):
    """Impulses of impacts on the first of two bodies, p (m, 3), N s, along the world's axes, at times t (m,), s."""

    t: np.ndarray
    p: np.ndarray


class ContactForces(dict[str, np.ndarray]):
    """Forces (n, 3) [N] by pair of bodies, on the first of the two, along the world's axes.

        m (v(t2) - v(t1)) = integral F dt + sum p     of a body, F with its weight and other forces

    A pair is named "FIRST - SECOND", such as "foot - ground"; the second body has the opposite force. `slips` have the
    same pairs, `impulses` those of them that hit; axes and signs are the same.
    """

    # run: a Trajectory, whose module imports this one.
    def __init__(self, run: Any) -> None:
        super().__init__((pair, np.nansum(forces, axis=1)) for pair, (_, forces) in run.contacts.items())
        for _, pair, _ in () if run.solution is None else run.solution.impulses:  # what presses at no sample
            self.setdefault(pair, np.zeros((len(run.t), 3)))
        self._run = run

    @functools.cached_property
    def slips(self) -> dict[str, np.ndarray]:
        """Velocity of slip of the first body on the second, by pair (n, k, 3), m/s, along the world's axes.

            c = (1 - n n^T) (v_a - v_b),   T . c <= 0

        v_a, v_b: velocities of the two bodies at the point of contact; n: the normal there; T: friction on the first
        body. Points are those of `Trajectory.contacts`, NaN where they are apart; of pairs that touch at no
        sample there are none, (n, 0, 3). At the samples; at an event after it.
        Raises SceneError (code "no-equations") for a loaded trajectory.
        """
        self._run._solution("contact_forces.slips")
        found, none = self._run._at_samples("contact_slips", None), np.empty((len(self._run.t), 0, 3))
        return {pair: found[pair][1] if pair in found else none for pair in self}

    @functools.cached_property
    def impulses(self) -> dict[str, PairImpulses]:
        """Impulses of impacts by pair: times t (m,), s, and p (m, 3), N s, on the first body.

        Those of all points of a pair at a time are one; so is what a pair that touched already passes on. Located:
        bounces too small to follow have none. Stepped: those of steps in which bodies hit, which `ContactForces` has in
        the mean force of that step too, less what pressed in the step before; like all of a step of first order in it.
        Raises SceneError (code "no-equations") for a loaded trajectory.
        """
        found: dict[str, dict[float, np.ndarray]] = {}
        for t, pair, p in self._run._solution("contact_forces.impulses").impulses:
            own = found.setdefault(pair, {})
            own[t] = own.get(t, 0.0) + p
        return {pair: PairImpulses(np.array(list(own)), np.array(list(own.values()))) for pair, own in found.items()}

    def on(self, body: str) -> np.ndarray:
        """The sum of the forces on a body that touches others (n, 3), N, along the world's axes.

        body: the name of a link, of all its shapes; of one of these as pairs have it; or "ground". Raises SceneError
        for what no pair has.
        """
        from twolink.effects.contact import Contact  # which runs without contacts do not load
        from twolink.effects.contact_pairs import labels_of, solids_of

        robot, effects = self._run.robot, [] if self._run.scene is None else self._run.scene.effects
        shapes = [solids_of(robot, one.shapes) for one in effects if isinstance(one, Contact)] or [robot.solids]
        links = {label: link for solids in shapes for (link, _), label in labels_of(solids).items()}
        known, total = dict[str, None](), np.zeros((len(self._run.t), 3))
        for pair, force in self.items():
            parts = pair.split(" - ")  # which names may have in themselves
            every = [(" - ".join(parts[:k]), " - ".join(parts[k:])) for k in range(1, len(parts))]
            two = next((two for two in every if two[0] in links or robot.model.existFrame(two[0])), every[0])
            for name, sign in zip(two, (1.0, -1.0), strict=True):
                known |= dict.fromkeys((name, links.get(name, name)))
                total += sign * force * (body in (name, links.get(name)))
        require_known(body, known, SceneError, argument="body")
        return total

    def __repr__(self) -> str:
        if not self:
            return "<no contact forces>"
        width = max(map(len, self))
        return "\n".join(f"{pair:<{width}}  {len(force)} x 3, up to {np.linalg.norm(force, axis=1).max():.4g} N"
                         for pair, force in self.items())  # fmt: skip
