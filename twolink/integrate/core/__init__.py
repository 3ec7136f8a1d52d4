"""Motion: what every kind of solution can do, the loop that leads it, and smooth motion.

motion   the interface, and `drive`: THE loop
columns    solutions as columns of one array, stepped together
track    what a solution passed: its states at any time
smooth   motion without modes, and its solution
"""
