"""Rigid-body algorithms as formulas over plain arithmetic and a namespace `xp`: NumPy runs them, a tape records them.

In: the constants of a mechanism and its state as numbers, arrays or expressions. Out: torques, accelerations, mass
matrices, factors and derivatives of the same kind. This room knows no file, no `Robot` and no compiler.
"""
