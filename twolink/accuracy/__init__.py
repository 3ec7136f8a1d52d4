"""Accuracy: what each further digit of an answer costs in time, measured for a scene by every method."""

from twolink.accuracy.result import Study
from twolink.accuracy.study import accuracy_study

__all__ = ["Study", "accuracy_study"]
