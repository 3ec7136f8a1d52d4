"""Contact: time stepping of bodies that touch at many points.

In: a scene, times and a step; the points at which bodies touch come from `geometry`. Out: states at the times, the
impulses of the contacts, and of each step how well they obey the laws. This room knows nothing of error bars and
trajectories.

bodies        mass matrix, free motion and Jacobians at the points where bodies touch; of many free bodies, sparse
joints        stops and dry friction of joints, as points of the contact problem, and motions that loops leave free
impulses      the contact problem: impulses that obey the laws of contact and friction
positions     what removes overlap and drift from positions
compiled      scenes as arrays for the native library, which takes their steps; compiled_steps: what it says of them
rest          steps in which nothing moves
stepping      one step; steps: what it is, and those of a run
solver        the run from step to step
choice        whether contacts are located or stepped
"""
