"""The paper: its figures and claims, and the throws that it opens with.

In: the paper's arm. Out: figures, and for each claim whether it holds.
"""
