"""Accuracy: what each further digit of an answer costs in time, measured for a scene by every method."""

from twolink.accuracy.conduct import accuracy_study
from twolink.accuracy.study import Study

__all__ = ["Study", "accuracy_study"]
