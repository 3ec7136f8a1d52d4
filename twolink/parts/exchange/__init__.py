"""Exchange: our models in forms that other programs read, and other models and equations held against ours.

In: robots, scenes, equations by hand. Out: C, URDF, MJCF and FMU files; differences of two models or of equations with
their causes. This room knows no service.
"""
