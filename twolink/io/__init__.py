"""Files and listings: tables of named columns, files written whole or not at all, fingerprints, tables that print well.

In: arrays, texts and paths. Out: files, their contents, digests, listings. This room knows nothing of robots or dynamics.
"""
