"""Exchange: what other files and programs say, held against our equations, and our equations in forms they read.

In: robots, scenes, equations by hand, and trajectories of any simulator. Out: a scene with all that a URDF says,
differences of two models or of equations with their causes, and a verdict on a trajectory. This room knows no command
and no service.
"""
