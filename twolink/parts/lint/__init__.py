"""Linting: every defect of a robot's file at once, with its place, its likely cause and what was expected.

In: a URDF, xacro, MJCF or SRDF. Out: `Findings`, as text, JSON, SARIF or annotations of a code host. The rules are
declared in `rules.toml`; what the load report says too is said in its words. This room knows nothing of motions.
"""
