"""Events: where a scene's modes change. Smooth pieces between located events, from a scene's switches.

event      what run.events lists
moment     what guards and laws see of states: motion, accelerations, forces
locating   the first zero of guards along a piece
modes      the modes of a scene, and the equations of each
impacts    velocities after an impact
deciding   the modes that are consistent with the laws of friction and contact
run        piece by piece to the end
"""
