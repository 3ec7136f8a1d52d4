"""Referee: whether a trajectory of any simulator solves a scene, since when not, by how much and why.

In: a scene and a log, or a peer that makes one. Out: a `Verdict` with causes. This room knows no service.
"""
