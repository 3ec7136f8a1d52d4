"""The paper: its figures and claims, and the throws that it opens with.

In: the paper's arm. Out: figures, and for each statement whether it holds, with its number.

motions        the release by hand-derived equations and by URDF
claims         statements about the motion        model_claims   about equations, methods and conclusions
beyond         link one beyond -pi                ode45          what default tolerances make of the release
figures        figures 6 to 13, and the study     throw          the best time to let go of a ball
"""
