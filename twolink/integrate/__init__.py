"""Integration: the equations of motion of a scene, the methods that solve them, and the engine for events.

In: a scene, times, a method and its tolerance or step. Out: states at the times, dense output, events and counts of
the work. The engine for events knows modes, guards, transitions and constraints, but no effect by name. This room
knows nothing of error bars, figures or files of results.

motion: the equations. steps: methods, compiled steps, batches. core: motion, and the loop that drives it. hybrid:
events and modes. solvers: Taylor, SciPy. derivatives: of motions. solver.py is the door to all, and chooses among them.
"""
