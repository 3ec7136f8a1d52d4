"""Work: jobs, the worker processes that do them under limits, and their tasks.

In: requests' bodies. Out: results as data and files, and progress. It knows no HTTP.
"""
