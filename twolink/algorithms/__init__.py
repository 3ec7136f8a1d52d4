"""Rigid-body dynamics as formulas over plain arithmetic: NumPy runs them, heyoka compiles them."""
