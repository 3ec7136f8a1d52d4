"""Parts: what stands on the core, each on its own. The core never imports a part, and its tests pass without them.

service         queries, runs and playback over HTTP, with a page
identification  parameters of a robot from measured motions
design          equilibria, linearization, regulators, periodic motions, optimization
sweeps          many runs in a store that survives what stops them
exchange        robots and scenes in other programs' forms, and models compared
lint            defects of robot files
referee         verdicts on the trajectories of other simulators
gym             environments of Gymnasium

A part has a `commands` module where it has commands; the command line loads those of the parts that there are.
"""
