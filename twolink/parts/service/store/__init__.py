"""Storage of jobs, results and uploaded robots in the data folder; and content that comes and goes as bytes.

In and out: bytes, files and rows. It computes nothing.
"""
