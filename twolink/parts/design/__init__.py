"""Design: small motions around states, equilibria and periodic motions, regulators, and numbers of a scene chosen best.

In: a scene; for optimization bounds of some of its numbers by name, an objective and constraints as functions of a
run. Out: a `Linearization` (A, B, eigenvalues, stability, controllability), `Equilibria`, a `PeriodicMotion` with its
Floquet multipliers, `lqr`'s regulator, which is an effect; a `Gradient`, an `Optimum` with its run and how far it can
be trusted. This room knows no service.
"""
