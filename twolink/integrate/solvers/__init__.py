"""Solvers beside compiled steps: Taylor's method, SciPy's, and the choice among all."""
