"""Files and listings: tables, files written whole or not at all, fingerprints.

In: arrays, texts and paths. Out: files, their contents, digests, listings. This room knows nothing of robots or
dynamics.
"""
