"""The version of twolink."""

__version__ = "0.1.0"
