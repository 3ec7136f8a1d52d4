"""Integration: states on their manifold, methods, and the solution of an initial-value problem."""
