"""HTTP: the application with its endpoints, access control, and the server.

In: requests. Out: answers, problems and streams of progress. Of computing it does queries of a few states only.
"""
