"""Contact: time stepping of bodies that touch at many points.

In: the equations of a scene, its `Contact` effects, times and a step. Out: states at the times, the impulses of the
contacts, and of each step how well they obey the laws. This room knows nothing of error bars and trajectories.

detection     the points at which bodies touch or are about to, with gaps and normals
points        these as data; formulas, hulls, hull_pairs: what finds them, by shapes
multibody     mass matrix, free motion and Jacobians at those points; free_bodies: of many free bodies
joints        stops and dry friction of joints, as points of the contact problem
loops         motions that loops leave free
impulses      the contact problem: impulses that obey the laws of contact and friction
held          steps in which the same points press, compiled; held_step, cone_newton: their formulas
stepping      one step; step: what it is; plan: the steps of a run
solver        the run from step to step
"""
