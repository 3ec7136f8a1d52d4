"""Accuracy studies: what each further digit of an answer costs in time, measured for a scene and several methods.

In: a scene, methods, tolerances. Out: a `Study`: errors against a reference of known precision, seconds, the methods
that no other beats. This room knows no command line and no service.
"""

from twolink.accuracy.study import Study, accuracy_study

__all__ = ["Study", "accuracy_study"]
