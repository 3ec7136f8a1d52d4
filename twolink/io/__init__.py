"""Files, texts and listings: tables, CSV, strict numbers, files written whole or not at all, fingerprints.

In: arrays, texts, paths and a pin.Model. Out: files, their contents, digests, listings. This room knows nothing of
robots or dynamics.
"""
