"""Geometry of contact: gaps between shapes, features of hulls, and the points at which bodies touch.

In: shapes of links, and where these are. Out: gaps, normals, the nearest points. This room knows no laws of contact, no
effects and no time. Each formula is written once: over the motion of one robot it is evaluated for many states or
compiled, for events; over the links of all pairs at once by NumPy, for time stepping.

fields        ground of heights over a grid, and where bodies touch it
gaps          distance, common normal and nearest points of two shapes
hulls         convex hulls: faces, edges, how far two are apart, and the points at which they touch
distance      how far any two shapes are apart, by Coal, with checked normals
features      which corners, faces and edges of two hulls touch, with formulas of their gaps
pairs         the gaps of a pair of bodies, by their shapes
points        points at which bodies touch, and formulas for many at once
detection     the points of all pairs of a robot at which bodies touch or are about to
"""
