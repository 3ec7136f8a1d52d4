"""Control: small motions around states, equilibria and periodic motions, and regulators made from them.

In: a scene. Out: a `Linearization` (A, B, eigenvalues, stability, controllability), `Equilibria`, a `PeriodicMotion`
with its Floquet multipliers, and `lqr`'s regulator, which is an effect. This room knows no command line and no service.
"""
