"""What stays: jobs, results and uploaded robots in the data folder; and what comes and goes as bytes.

In and out: bytes, files and rows. It computes nothing.
"""
