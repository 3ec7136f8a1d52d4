"""The loop: controllers and sensors of a scene, from tick to tick.

In: the states of solutions at ticks. Out: the numbers that hold until the next tick, and the readings of sensors. This
room knows exact times, seeds and Python functions, but no integration method.
"""
