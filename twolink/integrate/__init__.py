"""Integration: states on their manifold, methods, and the solution of an initial-value problem."""

from twolink.integrate.methods import METHODS, Method, method_named
from twolink.integrate.scipy_solver import Solution, solve
from twolink.integrate.state import StateSpace

__all__ = ["METHODS", "Method", "Solution", "StateSpace", "method_named", "solve"]
