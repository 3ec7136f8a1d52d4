"""Adjoints along a run: a covector at each sample pulled back to the start and to the parameters.

    dF = sum_n c_n^T dx_n:   w- = Phi^T w+ + c_n,   dF/dp = sum w+^T dx+/dp

Phi are the matrices of the legs, one for each step, which do not depend on each other; through an event w goes back by
the transposed saltation matrix. The parameters' part comes from `integrate.adjoint_steps`: its cost does not grow with
their number.
"""

from dataclasses import replace

import numpy as np

from twolink.integrate.adjoint_steps import AdjointSteps
from twolink.integrate.equations import Equations
from twolink.integrate.variational_legs import Leg
from twolink.simulation.nominal_solutions import NominalSolution, NominalSolutions
from twolink.simulation.sensitivity_names import Wanted
from twolink.simulation.trajectory import Trajectory

Array = np.ndarray


class AdjointRun:
    """The run of a scene and second ones, along which covectors are pulled back.

    samples: of the run, at which covectors may be other than 0, (m,) numbers. Attributes: nominals, the solutions: the
    run's, then the second ones.
    """

    def __init__(
        self, run: Trajectory, equations: Equations, wanted: Wanted, accuracy: float, tolerance: float, samples: Array
    ) -> None:
        self._wanted, self._samples = wanted, samples
        self._own = own = NominalSolutions(run, equations, wanted, accuracy, along_state=True)
        times = np.union1d(own.times(own.first), run.t[samples])
        legs = [own.leg(own.first, number, times, tolerance) for number in range(len(own.first.edges))]
        begins = [begin for begin, _ in own.first.edges]
        piece = np.maximum(np.searchsorted(begins, run.t[samples], side="right") - 1, 0)
        self._places = [(np.searchsorted(leg.t, run.t[samples[piece == number]]), np.flatnonzero(piece == number))
                        for number, leg in enumerate(legs)]  # fmt: skip
        self.nominals = [own.first, *(own.second(legs, one, run.t) for one in own.second_ones())]
        for nominal in self.nominals[1:]:
            own.require_alike(nominal)
        self._legs = [legs, *([own.beside(leg, nominal, number) for number, leg in enumerate(legs)]
                              for nominal in self.nominals[1:])]  # fmt: skip

    def pulled_back(self, number: int, covectors: Array) -> Array:
        """dF (k,) by each column that is wanted, along a nominal solution, from covectors (m, 2 nv) at the samples."""
        nominal, legs, wanted = self.nominals[number], self._legs[number], self._wanted
        states = covectors.shape[1]
        w, by_parameters = np.zeros(states), np.zeros(len(wanted.neighbours.names))
        for piece in reversed(range(len(legs))):
            places, samples = self._places[piece]
            added = np.zeros((len(legs[piece].t), states))
            added[nominal.second.parts * places] = covectors[samples]
            if piece + 1 < len(legs) and nominal.jumps:
                through = self._own.after(nominal, piece, np.eye(states + len(by_parameters)))[:states]
                by_parameters += w @ through[:, states:]
                w = w @ through[:, :states]
            after = np.empty((len(added), states))
            after[-1] = w + added[-1]
            for n, matrix in zip(reversed(range(len(added) - 1)), reversed(legs[piece].matrices), strict=True):
                after[n] = after[n + 1] @ matrix + added[n]
            w = after[0]
            if len(by_parameters):
                by_parameters += self._by_parameters(nominal, piece, legs[piece], after[1:].T)
        return np.asarray(np.concatenate([w, by_parameters]) @ self._own.start(nominal))

    def _by_parameters(self, nominal: NominalSolution, piece: int, leg: Leg, covectors: Array) -> Array:
        """What the steps of a leg add, with covectors (2 nv, m - 1) at their ends."""
        steps = AdjointSteps(*self._own.driven(nominal, piece))
        return steps.by_parameters(leg.t[:-1], leg.x[:, :-1], leg.t[1:], np.ascontiguousarray(covectors))


def with_states(run: Trajectory, nominal: NominalSolution) -> Trajectory:
    """The run with the states of a second solution at its samples."""
    states = nominal.dense.states(np.minimum(run.t, nominal.edges[-1][1]))
    q, v = nominal.dense.pieces[0].equations.space.rows(states)
    return replace(run, q=q, v=v, error=None, precise=None, recorded_energy=None, solution=nominal.dense)
