"""Solvers beside compiled steps: Taylor's method and SciPy's."""
