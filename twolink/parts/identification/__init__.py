"""Parameters of a robot from measured motions: which can be told, their values with intervals, and a URDF with them.

In: a robot, measured q, v, a and joint torques; or a scene and measured positions. Out: base parameters in words, an
`Identification` or a `SceneFit`, trajectories that excite all parameters. This room knows no command line and no
service.
"""
